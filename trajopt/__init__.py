"""Optimal control of hybrid systems, and the rimless wheel's gaits of least cost of transport.

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
    from trajopt.ocp.judge.extremal import Extremal
    from trajopt.ocp.judge.saved import ExtremalFileError, load_phases
    from trajopt.ocp.pose.bounds import InfeasibleBoundsError
    from trajopt.ocp.pose.problem import Constraint, Linkage, Phase, Problem, equal, nonnegative
    from trajopt.ocp.search.continuation import Curve, continued
    from trajopt.ocp.search.multi_start import Search, best_of, multi_start
    from trajopt.ocp.solving.interrupted import Interrupted
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
    "ocp.judge.extremal": ("Extremal",),
    "ocp.judge.saved": ("ExtremalFileError", "load_phases"),
    "ocp.pose.bounds": ("InfeasibleBoundsError",),
    "ocp.pose.problem": ("Constraint", "Linkage", "Phase", "Problem", "equal", "nonnegative"),
    "ocp.search.continuation": ("Curve", "continued"),
    "ocp.search.multi_start": ("Search", "best_of", "multi_start"),
    "ocp.solving.interrupted": ("Interrupted",),
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
