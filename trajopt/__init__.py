"""Optimal control of the rimless wheel: periodic gaits of least cost of transport."""

from trajopt.fronts import CotFront, cot_front
from trajopt.gaits import NoGaitError, periodic_gait
from trajopt.solution import Solution
from trajopt.verify import Verification

__all__ = ["CotFront", "NoGaitError", "Solution", "Verification", "cot_front", "periodic_gait"]
