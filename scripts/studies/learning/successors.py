"""Trials that need a policy of another row, of the same seed, which is trained before."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Self

from agents.folder import BEST, CLONE, LAST
from rimless_gym.params import WheelParams
from scripts.studies.learning.row import Row
from scripts.studies.learning.trials import RESULT, Trained


@dataclasses.dataclass(frozen=True)
class Successor(Trained):
    """A training that needs a policy of another row.

    Attributes:
        before: the other row.
    """

    before: Row = dataclasses.field(kw_only=True)

    @property
    def settings(self) -> dict[str, Any]:
        """The fields, with the settings of the other row's trial."""
        other = {"row": self.before.name, "trial": self.before.trial.settings}
        return super().settings | {"before": other}

    def brief(self) -> Self:
        """The same with the fewest steps, after a brief trial of the other row."""
        return dataclasses.replace(super().brief(), before=self.before.brief())

    def found(self, seed: int, folder: Path, file: str) -> str:
        """A policy's file of the other row's seed, in the folder beside this one's.

        Raises:
            ValueError: that seed is not finished.
        """
        name = self.before.name
        other = folder.with_name(f"{name}_{seed}")
        if not (other / RESULT).exists():
            raise ValueError(
                f"{other.name} is not finished, and {folder.name} needs its policy: run --rows "
                f"{name} to its end first"
            )
        return str(other / file)


@dataclasses.dataclass(frozen=True)
class Distilled(Successor):
    """An imitation of the best policy of another row."""

    def expert(self, seed: int, folder: Path, params: WheelParams) -> str:
        """The policy's file."""
        return self.found(seed, folder, BEST)


@dataclasses.dataclass(frozen=True)
class Continued(Successor):
    """A training that begins with the clone of another row."""

    @property
    def cloned(self) -> None:
        """It does not clone: the other row has."""

    def start(self, seed: int, folder: Path) -> str:
        """The clone's file."""
        return self.found(seed, folder, CLONE)


@dataclasses.dataclass(frozen=True)
class WentOn(Continued):
    """A training that begins with the last policy of another row."""

    def start(self, seed: int, folder: Path) -> str:
        """The policy's file."""
        return self.found(seed, folder, LAST)
