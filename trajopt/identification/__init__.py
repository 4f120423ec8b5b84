"""A machine's parameters from a log of its walking."""

from trajopt.identification.fit import Identification, Noise, identify
from trajopt.identification.log import Log, LogError

__all__ = ["Identification", "Log", "LogError", "Noise", "identify"]
