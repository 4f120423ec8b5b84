"""Optimal control of hybrid systems, and the rimless wheel's gaits of least cost of transport."""

from trajopt.extremal import Extremal
from trajopt.gaits.fronts import CotFront, cot_front
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.gaits.verify import Verification
from trajopt.mesh import Mesh
from trajopt.problem import (
    Constraint,
    InfeasibleBoundsError,
    Linkage,
    Phase,
    Problem,
    equal,
    nonnegative,
)
from trajopt.solve import solve
from trajopt.trajectory import PhaseTrajectory

__all__ = [
    "Constraint",
    "CotFront",
    "Extremal",
    "InfeasibleBoundsError",
    "Linkage",
    "Mesh",
    "NoGaitError",
    "Phase",
    "PhaseTrajectory",
    "Problem",
    "Solution",
    "Verification",
    "cot_front",
    "equal",
    "nonnegative",
    "periodic_gait",
    "solve",
]
