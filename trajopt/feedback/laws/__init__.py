"""The feedback laws that hold a gait, one per file, named after it: each has `design(solution)`.

A new law is one new file in this folder. `design(name, solution)` here puts the catch and the guard
around it, so that it starts from rest and finds its gait after a push; the comparison of laws and
policies takes it up. A law that is not in the folder may be given in place of a name.
"""

from __future__ import annotations

import importlib
import pkgutil
import reprlib
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from trajopt.feedback.law import Controller, Law
    from trajopt.gaits.solution import Solution


#: Laws that take minutes to design, or to walk as long as a policy is judged for.
SLOW = ("receding_horizon", "tuned")


def names() -> list[str]:
    """The names of all laws."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def holding(law: str | Law, solution: Solution) -> Law:
    """The law of this name about a gait, by itself: it holds the gait and does not look for it.

    A law that does not hold it is warned of, where its multipliers say so
    (`trajopt.feedback.closed_loop`).

    Args:
        law: its name, or a law that was designed for this gait, which is returned.
        solution: the gait.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: there is no such law, its file is not that of a law, it is for another machine,
            or the gait failed its verification.
    """
    from trajopt.feedback.law import Law
    from trajopt.feedback.requirements import require_machine, require_verified

    if not isinstance(law, str | Law):
        raise TypeError(
            f"law = {reprlib.repr(law)}: must be one of {names()}, or a trajopt.feedback.law.Law"
        )
    require_verified(solution)
    found = _designed(law, solution) if isinstance(law, str) else law
    require_machine("law", found, solution.params)
    _warn_of_growth(found, solution)
    return found


def design(law: str | Law, solution: Solution, folder: Path | None = None) -> Controller:
    """The law of this name for a gait, with the catch that leads to it and a guard for the foot.

    The catch is planned once for a gait, which takes up to half a minute, and kept in memory: other
    laws for the same gait share it.

    Args:
        law: see `holding`.
        solution: the gait.
        folder: where the catch is kept in a file too, for other processes; None: nowhere.

    Raises:
        TypeError, ValueError: see `holding`; or the catch's file is damaged.
        OSError: the folder cannot be written.
    """
    from trajopt.feedback.catch.catch import catch_for
    from trajopt.feedback.guard import Guarded, margin_for
    from trajopt.feedback.joined import NEAR, Joined

    found = holding(law, solution)
    return Guarded(
        found.params, Joined(found, catch_for(found, NEAR, folder)), margin_for(solution)
    )


def _designed(name: str, solution: Solution) -> Law:
    """What the file of this name designs."""
    from trajopt.feedback.law import Law

    if name not in names():
        raise ValueError(f"law = {name!r}: choose from {names()}")
    module = importlib.import_module(f"{__name__}.{name}")
    if not callable(getattr(module, "design", None)):
        raise ValueError(
            f"{module.__file__}: has no function design(solution), so that it is no law; write "
            "one, or move the file out of this folder"
        )
    law = module.design(solution)
    if not isinstance(law, Law):
        raise ValueError(
            f"{module.__file__}: design returned {reprlib.repr(law)}; must return a "
            "trajopt.feedback.law.Law"
        )
    return law


def _warn_of_growth(law: Law, solution: Solution) -> None:
    from trajopt.feedback.closed_loop import multipliers

    if law.smooth and (largest := multipliers(law, solution)[0]) > 1.0:
        warnings.warn(
            f"{law}: does not hold its gait by itself: a small deviation grows {largest:.3g}-fold "
            "in a stride; take another law or other gains",
            stacklevel=3,
        )
