"""Optimal control of hybrid systems, and the rimless wheel's gaits of least cost of transport."""

from trajopt.extremal import Extremal
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
    "Extremal",
    "InfeasibleBoundsError",
    "Linkage",
    "Mesh",
    "Phase",
    "PhaseTrajectory",
    "Problem",
    "equal",
    "nonnegative",
    "solve",
]
