"""Optimal control of hybrid systems, and gaits of least cost of transport; part of rimless-gym.

`trajopt.ocp` is an engine for any hybrid system; `trajopt.gaits` and `trajopt.feedback` are the
wheel's. The names below are looked up when they are first used, so that the engine can be imported
without the wheel.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what `__getattr__` finds
    from trajopt.gaits.fronts import CotFront, cot_front
    from trajopt.gaits.periodic import NoGaitError, periodic_gait
    from trajopt.gaits.solution import Solution
    from trajopt.gaits.verify import Verification
    from trajopt.ocp.interrupted import Interrupted
    from trajopt.ocp.pose.bounds import InfeasibleBoundsError
    from trajopt.ocp.pose.constraint import Constraint, equal, nonnegative
    from trajopt.ocp.pose.linkage import Linkage
    from trajopt.ocp.pose.phase import Phase
    from trajopt.ocp.pose.problem import Problem
    from trajopt.ocp.results.extremal import Extremal
    from trajopt.ocp.results.saved import ExtremalFileError, load_phases
    from trajopt.ocp.search.continuation import continued
    from trajopt.ocp.search.curve import Curve
    from trajopt.ocp.search.multi_start import best_of, multi_start
    from trajopt.ocp.search.search import Search
    from trajopt.ocp.solving.solve import solve
    from trajopt.ocp.transcribe.mesh import Mesh
    from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

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

_MODULES = {
    "gaits.fronts": ("CotFront", "cot_front"),
    "gaits.periodic": ("NoGaitError", "periodic_gait"),
    "gaits.solution": ("Solution",),
    "gaits.verify": ("Verification",),
    "ocp.interrupted": ("Interrupted",),
    "ocp.pose.bounds": ("InfeasibleBoundsError",),
    "ocp.pose.constraint": ("Constraint", "equal", "nonnegative"),
    "ocp.pose.linkage": ("Linkage",),
    "ocp.pose.phase": ("Phase",),
    "ocp.pose.problem": ("Problem",),
    "ocp.results.extremal": ("Extremal",),
    "ocp.results.saved": ("ExtremalFileError", "load_phases"),
    "ocp.search.continuation": ("continued",),
    "ocp.search.curve": ("Curve",),
    "ocp.search.multi_start": ("best_of", "multi_start"),
    "ocp.search.search": ("Search",),
    "ocp.solving.solve": ("solve",),
    "ocp.transcribe.mesh": ("Mesh",),
    "ocp.transcribe.trajectory": ("PhaseTrajectory",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"trajopt.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
