"""Gaits of a front in files of their own: each holds the gait, or why there is none."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from rimless_gym.params import WheelParams
from trajopt.files import read_arrays, write_arrays
from trajopt.gaits.gait_file import GaitFileError
from trajopt.gaits.solution import Solution

MISSING = "rimless-gym missing gait 1"


class Wanted(NamedTuple):
    """A gait of a front.

    Attributes:
        params: the machine.
        speed: m/s.
        steps: per stride.
        regeneration: whether the battery takes energy back.
        hold: period of the clock (s); None without one.
    """

    params: WheelParams
    speed: float
    steps: int
    regeneration: bool
    hold: float | None = None


def front_file(steps: int, speed: float, hold: float | None = None) -> str:
    """The name of the file in which a gait is kept."""
    clock = "" if hold is None else f"_hold_{hold:g}"
    return f"front_{steps}_steps_{speed:g}{clock}.npz"


def keep(folder: Path, wanted: Wanted, found: Solution | str) -> None:
    """Write the gait that was found, or the reason why none was."""
    path = folder / front_file(wanted.steps, wanted.speed, wanted.hold)
    if isinstance(found, str):
        write_arrays(path, MISSING, _described(wanted) | {"why": found}, {})
    else:
        found.save(path)


def kept(folder: Path, wanted: Wanted) -> Solution | str | None:
    """The gait in a file, or the reason why there is none; None if the file is missing or damaged.

    A file of another machine or speed counts as missing.
    """
    path = folder / front_file(wanted.steps, wanted.speed, wanted.hold)
    if not path.exists():
        return None
    try:
        gait = Solution.load(path)
    except GaitFileError:
        return _why(path, wanted)
    same = (gait.params, gait.steps, gait.regeneration, gait.hold) == (
        *(wanted.params, wanted.steps, wanted.regeneration, wanted.hold),
    )
    return gait if same and abs(gait.speed - wanted.speed) < 1e-9 else None


def _why(path: Path, wanted: Wanted) -> str | None:
    try:
        header, _ = read_arrays(path, MISSING, GaitFileError, "")
    except GaitFileError:
        return None
    why = header.pop("why", None)
    return why if header == _described(wanted) else None


def _described(wanted: Wanted) -> dict[str, object]:
    return wanted._asdict() | {"params": wanted.params.to_dict()}
