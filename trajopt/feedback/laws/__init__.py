"""The feedback laws that hold a gait, one per file, named after it: each has `design(solution)`.

A new law is one new file in this folder. `design(name, solution)` here puts the catch and the guard
around it, so that it starts from anywhere; the comparison of laws and policies takes it up.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trajopt.feedback.law import Controller, Law
    from trajopt.gaits.solution import Solution


def names() -> list[str]:
    """The names of all laws."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def holding(name: str, solution: Solution) -> Law:
    """The law of this name about a gait, by itself: it holds the gait and does not look for it.

    Raises:
        TypeError: `solution` is not a `trajopt.Solution`.
        ValueError: there is no such law, or the gait failed its verification.
    """
    from trajopt.feedback.requirements import require_verified

    if name not in names():
        raise ValueError(f"law = {name!r}: choose from {names()}")
    require_verified(solution)
    law: Law = importlib.import_module(f"{__name__}.{name}").design(solution)
    return law


def design(name: str, solution: Solution) -> Controller:
    """The law of this name for a gait, with the catch that leads to it and a guard for the foot.

    The catch is planned once for a gait, which takes up to half a minute, and kept in memory: other
    laws for the same gait share it.

    Raises:
        TypeError: `solution` is not a `trajopt.Solution`.
        ValueError: there is no such law, or the gait failed its verification.
    """
    from trajopt.feedback.catch.catch import catch_for
    from trajopt.feedback.guard import Guarded, margin_for
    from trajopt.feedback.joined import NEAR, Joined

    law = holding(name, solution)
    catch = catch_for(law.params, law.data.orbit, NEAR)
    return Guarded(law.params, Joined(law, catch), margin_for(solution))
