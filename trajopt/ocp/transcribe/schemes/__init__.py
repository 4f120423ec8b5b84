"""Collocation schemes, one per file."""

from trajopt.ocp.transcribe.schemes.hermite_simpson import hermite_simpson
from trajopt.ocp.transcribe.schemes.radau import radau
from trajopt.ocp.transcribe.schemes.scheme import Scheme
from trajopt.ocp.transcribe.schemes.trapezoid import trapezoid

__all__ = ["Scheme", "hermite_simpson", "radau", "trapezoid"]
