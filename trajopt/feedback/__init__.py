"""Feedback laws that hold a gait.

Every file in `trajopt/feedback/laws` is a law. Its name is that of the file, and its function
``design(solution)`` returns the law for a gait as a `Controller`. A new law is a new file there.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable

from trajopt.feedback import laws as _laws
from trajopt.feedback.law import Controller
from trajopt.feedback.laws.lqr import LimitCycleLqr
from trajopt.gaits.solution import Solution

__all__ = ["Controller", "LimitCycleLqr", "law", "laws"]

# The two functions below have the names of two submodules. Both are imported above, so the
# functions are what these names mean; ``from trajopt.feedback.law import ...`` works as well.


def laws() -> tuple[str, ...]:
    """Names of the feedback laws, in alphabetical order."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(_laws.__path__)))


def law(name: str) -> Callable[[Solution], Controller]:
    """The function that designs the law of this name for a gait.

    Raises:
        ValueError: there is no such law.
    """
    if name not in laws():
        raise ValueError(f"name = {name!r}: must be one of {', '.join(laws())}")
    design: Callable[[Solution], Controller]
    design = importlib.import_module(f"{_laws.__name__}.{name}").design
    return design
