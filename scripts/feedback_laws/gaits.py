"""The held gaits of the study, solved once and kept in files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import preset
from trajopt.gaits.gait_file import GaitFileError
from trajopt.gaits.held.clock import held_speed
from trajopt.gaits.periodic import periodic_gait
from trajopt.gaits.solution import Solution


class Held(NamedTuple):
    """A gait of a preset, under a voltage that is held for a control interval.

    Attributes:
        preset: the machine's name.
        speed: m/s.
    """

    preset: str
    speed: float

    @property
    def key(self) -> str:
        """For files, such as buildable_0.56."""
        return f"{self.preset.lower()}_{self.speed:g}"

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return preset(self.preset)

    def solved(self) -> Solution:
        """The gait."""
        return periodic_gait(self.params, self.speed, hold=CONTROL_PERIOD)

    def is_that_of(self, path: Path) -> bool:
        """Whether a file can be read, and has a gait of this machine, speed and hold."""
        try:
            gait = Solution.load(path)
        except (FileNotFoundError, GaitFileError):
            return False
        if gait.params != self.params or gait.hold != CONTROL_PERIOD:
            return False
        nearest = held_speed(self.params, self.speed, gait.steps, CONTROL_PERIOD)
        return math.isclose(gait.speed, nearest, rel_tol=1e-6)


#: The gaits of the study.
GAITS = (
    Held("BUILDABLE", 0.5),
    Held("BUILDABLE", 0.56),
    Held("BUILDABLE", 0.605),
    Held("THESIS_PHYSICAL", 0.5),
    Held("THESIS_PHYSICAL", 0.57),
)


def kept(folder: Path, gaits: Sequence[Held]) -> dict[str, Path]:
    """Files of gaits by key; those that the folder does not have are solved."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {}
    for held in tqdm(gaits, desc="gaits"):
        path = paths[held.key] = folder / f"{held.key}.npz"
        if not held.is_that_of(path):
            held.solved().save(path)
    return paths
