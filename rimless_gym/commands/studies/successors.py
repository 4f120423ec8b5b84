"""Trials that need a policy of another row, of the same seed, which is trained before."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from agents import learners
from agents.folder import BEST, CLONE, LAST
from agents.training import SCRATCH
from rimless_gym.commands.studies.trials import RESULT, Trained
from rimless_gym.params import WheelParams
from trajopt.files import jsonable


@dataclasses.dataclass(frozen=True)
class Distilled(Trained):
    """An imitation of the best policy of another row, of the same seed, which is trained before.

    Attributes:
        teacher: the other row, which has the name of its learner.
    """

    teacher: str = ""

    @property
    def settings(self) -> dict[str, Any]:
        """The fields, with what both learners say."""
        taught = learners.learner(self.teacher).settings(SCRATCH).written
        return super().settings | {"taught_by": dict(jsonable(taught))}

    def expert(self, seed: int, folder: Path, params: WheelParams) -> str:
        """The policy's file, in the folder beside this one's."""
        return str(_of_another(self.teacher, seed, folder, BEST))


@dataclasses.dataclass(frozen=True)
class Continued(Trained):
    """A training that begins with the clone of another row, of the same seed, made before.

    Attributes:
        begun: the other row.
    """

    begun: str = ""

    def start(self, seed: int, folder: Path) -> str:
        """The clone's file, in the folder beside this one's."""
        return str(_of_another(self.begun, seed, folder, CLONE))


@dataclasses.dataclass(frozen=True)
class WentOn(Continued):
    """A training that begins with the last policy of another row, of the same seed."""

    def start(self, seed: int, folder: Path) -> str:
        """The policy's file, in the folder beside this one's."""
        return str(_of_another(self.begun, seed, folder, LAST))


def _of_another(row: str, seed: int, folder: Path, file: str) -> Path:
    """A policy of another row's seed.

    Raises:
        ValueError: that seed is not finished.
    """
    other = folder.with_name(f"{row}_{seed}")
    if not (other / RESULT).exists():
        raise ValueError(
            f"{other.name} is not finished, and {folder.name} needs its policy: run --rows {row} "
            "to its end first"
        )
    return other / file
