"""Optimal control of hybrid systems, and gaits of least cost of transport; part of rimless-gym.

`trajopt.ocp` is an engine for any hybrid system; `trajopt.gaits` and `trajopt.feedback` are the
wheel's. The names below are imported when they are first used, because CasADi takes a second.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what `__getattr__` finds
    from trajopt.gaits.fronts import CotFront, cot_front
    from trajopt.gaits.periodic import NoGaitError, periodic_gait
    from trajopt.gaits.solution import Solution
    from trajopt.gaits.verify import Verification
    from trajopt.identification import Identification, Log, LogError, Noise, identify
    from trajopt.ocp.constraints import Constraint, InfeasibleBoundsError, equal, nonnegative
    from trajopt.ocp.continuation import Curve, continued
    from trajopt.ocp.extremal import Extremal, ExtremalFileError, load_phases
    from trajopt.ocp.mesh import Mesh
    from trajopt.ocp.multi_start import Search, best_of, multi_start
    from trajopt.ocp.problem import Linkage, Phase, Problem
    from trajopt.ocp.solve import solve
    from trajopt.ocp.trajectory import PhaseTrajectory

__all__ = [
    "Constraint",
    "CotFront",
    "Curve",
    "Extremal",
    "ExtremalFileError",
    "Identification",
    "InfeasibleBoundsError",
    "Linkage",
    "Log",
    "LogError",
    "Mesh",
    "NoGaitError",
    "Noise",
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
    "identify",
    "load_phases",
    "multi_start",
    "nonnegative",
    "periodic_gait",
    "solve",
]

#: Modules, and the names that are imported from them.
_MODULES = {
    "gaits.fronts": ("CotFront", "cot_front"),
    "gaits.periodic": ("NoGaitError", "periodic_gait"),
    "gaits.solution": ("Solution",),
    "gaits.verify": ("Verification",),
    "identification": ("Identification", "Log", "LogError", "Noise", "identify"),
    "ocp.constraints": ("Constraint", "InfeasibleBoundsError", "equal", "nonnegative"),
    "ocp.continuation": ("Curve", "continued"),
    "ocp.extremal": ("Extremal", "ExtremalFileError", "load_phases"),
    "ocp.mesh": ("Mesh",),
    "ocp.multi_start": ("Search", "best_of", "multi_start"),
    "ocp.problem": ("Linkage", "Phase", "Problem"),
    "ocp.solve": ("solve",),
    "ocp.trajectory": ("PhaseTrajectory",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"trajopt.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value
