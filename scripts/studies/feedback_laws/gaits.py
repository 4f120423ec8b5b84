"""The held gaits of the study, solved once and kept in files."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import preset
from trajopt.gaits.held_stride import held_speed
from trajopt.gaits.periodic import periodic_gait
from trajopt.gaits.solution import GaitFileError, Solution


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

    def fault_of(self, path: Path) -> str | None:
        """Why a file does not have this gait, in words that name the file; None if it has it.

        Raises:
            FileNotFoundError: there is no such file.
        """
        try:
            gait = Solution.load(path)
        except GaitFileError as error:
            return str(error)
        if gait.params != self.params or gait.hold != CONTROL_PERIOD:
            return f"{path}: a gait of another machine or hold"
        nearest = held_speed(self.params, self.speed, gait.steps, CONTROL_PERIOD)
        if not math.isclose(gait.speed, nearest, rel_tol=1e-6):
            return f"{path}: a gait at {gait.speed:g} m/s, not {nearest:g} m/s"
        if not gait.verification.passed:
            return f"{path}: a gait that failed its verification"
        return None


#: The gaits of the study.
GAITS = (
    Held("BUILDABLE", 0.5),
    Held("BUILDABLE", 0.56),
    Held("BUILDABLE", 0.605),
    Held("THESIS_PHYSICAL", 0.5),
    Held("THESIS_PHYSICAL", 0.57),
)


def kept(folder: Path, gaits: Sequence[Held]) -> dict[str, Path]:
    """Files of gaits by key; those that the folder does not have are solved.

    Raises:
        ValueError: a folder is in the place of a gait's file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = {}
    for held in tqdm(gaits, desc="gaits"):
        path = paths[held.key] = folder / f"{held.key}.npz"
        if path.is_dir():
            raise ValueError(f"{path}: a folder in the place of a gait's file; move it away")
        if path.exists():
            if (fault := held.fault_of(path)) is None:
                continue
            tqdm.write(f"{fault}; it is solved again", file=sys.stderr)
        held.solved().save(path)
    return paths
