"""The learners, one file each: a class `Learner` derived from `agents.learner.Learner`.

A new learner is one new file in this folder. Its name is that of the file.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import TYPE_CHECKING

from rimless_gym.checks import extra

if TYPE_CHECKING:
    from agents.learner import Learner


def names() -> list[str]:
    """The names of all learners."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def learner(name: str) -> type[Learner]:
    """The learner of a name.

    Raises:
        ValueError: there is none of that name.
        MissingExtraError: what it is built on is not installed.
    """
    if name not in names():
        raise ValueError(f"algo = {name!r}: choose from {names()}")
    with extra("learn"):
        found: type[Learner] = import_module(f"{__name__}.{name}").Learner
    return found
