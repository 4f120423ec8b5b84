"""Optimal control of the rimless wheel: periodic gaits of least cost of transport."""

from trajopt.gaits import NoGaitError, periodic_gait
from trajopt.solution import Solution

__all__ = ["NoGaitError", "Solution", "periodic_gait"]
