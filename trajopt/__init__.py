"""Optimal control of hybrid systems, and the rimless wheel's gaits of least cost of transport."""

from trajopt.bounds import InfeasibleBoundsError
from trajopt.continuation import Curve, continued
from trajopt.extremal import Extremal
from trajopt.gaits.fronts import CotFront, cot_front
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.gaits.verify import Verification
from trajopt.interrupted import Interrupted
from trajopt.mesh import Mesh
from trajopt.problem import Constraint, Linkage, Phase, Problem, equal, nonnegative
from trajopt.saved import ExtremalFileError, load_phases
from trajopt.search import Search, best_of, multi_start
from trajopt.solve import solve
from trajopt.trajectory import PhaseTrajectory

__all__ = [
    "Constraint",
    "CotFront",
    "Curve",
    "Extremal",
    "ExtremalFileError",
    "InfeasibleBoundsError",
    "Interrupted",
    "Linkage",
    "Mesh",
    "NoGaitError",
    "Phase",
    "PhaseTrajectory",
    "Problem",
    "Search",
    "Solution",
    "Verification",
    "best_of",
    "continued",
    "cot_front",
    "equal",
    "load_phases",
    "multi_start",
    "nonnegative",
    "periodic_gait",
    "solve",
]
