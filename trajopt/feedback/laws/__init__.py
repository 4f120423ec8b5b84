"""The feedback laws, one per file, named after it: each has a function `design(solution)`.

A new law is one new file in this folder; the comparison of laws and policies takes it up.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trajopt.feedback.law import Controller
    from trajopt.gaits.solution import Solution


def names() -> list[str]:
    """The names of all laws."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def design(name: str, solution: Solution) -> Controller:
    """The law of this name for a gait.

    Raises:
        ValueError: there is no such law.
    """
    if name not in names():
        raise ValueError(f"law = {name!r}: choose from {names()}")
    law: Controller = importlib.import_module(f"{__name__}.{name}").design(solution)
    return law
