"""The feedback laws that hold a gait, one per file, named after it: each has `design(solution)`.

One that takes minutes has `design(solution, folder)`, and stores there what it found.

A new law is one new file in this folder. `design(name, solution)` here puts the start-up controller
and the contact guard around it, so that it starts from rest and finds its gait after a push; the
comparison of laws and policies includes it. A law that is not in the folder may be given in place
of a name.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import reprlib
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from trajopt.feedback.law import Controller, Law
    from trajopt.gaits.solution import Solution


#: Laws that take minutes to design, or to walk as long as a policy is evaluated for.
SLOW = ("receding_horizon", "tuned")


def names() -> list[str]:
    """The names of all laws."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def holding(law: str | Law, solution: Solution, folder: Path | None = None) -> Law:
    """The law of this name about a gait, by itself: it holds the gait, but does not lead to it.

    Warns if the law's multipliers are those of one that does not hold it
    (`trajopt.feedback.transverse.multipliers`).

    Args:
        law: its name, or a law that was designed for this gait, which is returned.
        solution: the gait.
        folder: where a law stores what takes minutes, for other processes; None: nowhere.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: there is no such law, it is for another machine, or the gait failed its
            verification.
    """
    from trajopt.feedback.law import Law, require_machine
    from trajopt.feedback.transverse import multipliers

    if isinstance(law, str):
        if law not in names():
            raise ValueError(f"law = {law!r}: choose from {names()}")
        designed = importlib.import_module(f"{__name__}.{law}").design
        stores = "folder" in inspect.signature(designed).parameters
        law = designed(solution, folder=folder) if stores else designed(solution)
    if not isinstance(law, Law):
        raise TypeError(
            f"law = {reprlib.repr(law)}: must be one of {names()}, or a trajopt.feedback.law.Law"
        )
    require_machine("law", law, solution.params)
    if law.smooth and (largest := multipliers(law, solution)[0]) > 1.0:
        warnings.warn(
            f"{law}: does not hold its gait by itself: a small deviation grows {largest:.3g}-fold "
            "in a stride; take another law or other gains",
            stacklevel=2,
        )
    return law


def design(law: str | Law, solution: Solution, folder: Path | None = None) -> Controller:
    """The law of this name for a gait, with the start-up controller and the contact guard.

    The start-up controller is computed once for a gait, which takes up to half a minute, and cached
    in memory: other laws for the same gait share it.

    Args:
        law: see `holding`.
        solution: the gait.
        folder: where the start-up controller is stored, too.

    Raises:
        TypeError, ValueError: see `holding`; or the start-up controller's file is damaged.
        OSError: the folder cannot be written.
    """
    from trajopt.feedback.controller import ContactGuard, SwitchingController, margin_for
    from trajopt.feedback.startup import lost_return, near_for, startup_for

    law = holding(law, solution, folder)
    orbit, weights = law.data.orbit, lost_return(law.params, solution.speed, solution.cot)
    near = near_for(law.params, orbit)
    startup = startup_for(law.params, orbit, near, weights, folder)
    switching = SwitchingController(law, startup, law.reach * near)
    return ContactGuard(law.params, switching, margin_for(solution))
