"""The gaits that are shipped with the package, from which searches near them start.

They are in one archive: the file of each gait, as `Solution.save` writes it, and an index. Thus a
search reads only the gaits from which it starts.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import zipfile
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import least_first
from trajopt.ocp.trajectory import PhaseTrajectory

ARCHIVE = Path(__file__).parent / "library" / "gaits.zip"

INDEX = "index.json"

#: Gaits whose distances in speed differ by less than this (m/s) are ranked by their CoT.
NEAR = 0.02


class Entry(NamedTuple):
    """A gait in the index."""

    name: str  # of the gait's file in the archive
    params: WheelParams  # the machine
    steps: int  # touchdowns per stride
    theta_turns: int  # whole turns that theta gains in a stride
    speed: float  # m/s
    cot: float  # cost of transport
    double_stance: bool = False  # whether it stops on two feet in every stride
    repeated: int = 1  # how many strides of the file make this one

    def load(self) -> Solution:
        """Read the gait."""
        return repeated(shipped_gait(self.name), self.repeated)


#: What can be ranked.
G = TypeVar("G", bound="Entry | Solution")


@lru_cache
def index() -> tuple[Entry, ...]:
    """All gaits of the archive, in order of file name."""
    with zipfile.ZipFile(ARCHIVE) as archive:
        content = json.loads(archive.read(INDEX))
    machines = [WheelParams(**fields) for fields in content["machines"]]
    return tuple(Entry(name, machines[i], *figures) for name, i, *figures in content["gaits"])


@cache
def shipped_gait(name: str) -> Solution:
    """The gait of a file in the archive."""
    with zipfile.ZipFile(ARCHIVE) as archive:
        return Solution.load(io.BytesIO(archive.read(name)))


def shipped(params: WheelParams | None = None) -> tuple[Solution, ...]:
    """The shipped gaits, or those of one machine, in order of file name."""
    return tuple(each.load() for each in index() if params in (None, each.params))


# -- warm starts ----------------------------------------------------------------------------------


def warm_starts(
    params: WheelParams,
    speed: float,
    steps: int,
    most: int | None = None,
    *,
    double_stance: bool = False,
) -> list[Solution]:
    """Shipped gaits of a machine to start from, the most promising first, at most `most`.

    See `ranked`. None if no gaits of the machine are shipped. With `double_stance` those that stop
    on two feet once in so many steps, of any machine if none of this one, else those that do not.
    """
    if double_stance:
        stopping = [e for e in index() if e.double_stance and e.steps == steps]
        stopping = [e for e in stopping if e.params == params] or stopping
        return [entry.load() for entry in ranked(stopping, speed)[:most]]
    return [entry.load() for entry in candidates(params, speed, steps)[:most]]


def candidates(params: WheelParams, speed: float, steps: int) -> list[Entry]:
    """The entries of `warm_starts`: gaits of as many steps, or of a divisor of them, repeated."""
    entries = []
    for divisor in range(1, steps + 1):
        if steps % divisor == 0:
            times = steps // divisor
            for entry in nearest(params, speed, divisor):
                turns = entry.theta_turns * times
                entries.append(entry._replace(steps=steps, theta_turns=turns, repeated=times))
    return ranked(entries, speed)


def nearest(params: WheelParams, speed: float, steps: int) -> list[Entry]:
    """The machine's shipped gaits of as many steps that are nearest in speed.

    One for every number of turns of theta.
    """
    fitting = [
        entry
        for entry in index()
        if (entry.params, entry.steps, entry.double_stance) == (params, steps, False)
    ]
    families: dict[int, Entry] = {}
    for entry in sorted(fitting, key=lambda entry: _gap(entry, speed)):
        families.setdefault(entry.theta_turns, entry)
    return list(families.values())


def ranked(gaits: Sequence[G], speed: float) -> list[G]:
    """Gaits sorted by distance in speed to within `NEAR`, then by cost.

    The cost that counts is a family's, all gaits of one number of turns of the pendulum: it is that
    of its gait nearest in speed. A slower gait of the family costs less and is no better a guess.
    """

    def nearness(gait: G) -> int:
        return round(_gap(gait, speed) / NEAR - 1e-3)  # shifted: round speeds are not on edge

    families: dict[tuple[int, int], list[G]] = {}
    by_cost = least_first(gaits, lambda gait: gait.cot)
    for gait in sorted(by_cost, key=lambda gait: _gap(gait, speed)):
        families.setdefault((nearness(gait), gait.theta_turns), []).append(gait)
    best = least_first(families.values(), lambda family: family[0].cot)
    best.sort(key=lambda family: nearness(family[0]))
    return [gait for family in best for gait in family]


def gaits_around(speed: float, steps: int, most: int) -> list[Solution]:
    """Shipped gaits of as many steps, of every machine, with every number of turns of theta.

    Args:
        speed: m/s.
        steps: per stride.
        most: gaits of one machine and number of turns, the nearest in speed.
    """
    families: dict[tuple[WheelParams, int], list[Entry]] = {}
    for entry in sorted(index(), key=lambda entry: _gap(entry, speed)):
        if entry.steps == steps and not entry.double_stance:
            families.setdefault((entry.params, entry.theta_turns), []).append(entry)
    return [entry.load() for family in families.values() for entry in family[:most]]


def _gap(gait: Entry | Solution, speed: float) -> float:
    """Distance in speed (m/s), rounded so that rounding does not decide between equal ones."""
    return round(abs(gait.speed - speed), 6)


def repeated(solution: Solution, times: int) -> Solution:
    """The same gait with `times` strides as one; its verification remains that of one stride."""
    if times == 1:
        return solution
    phases = repeated_phases(solution.phases, solution.theta_turns, times)
    return dataclasses.replace(solution, phases=phases, theta_turns=solution.theta_turns * times)


def repeated_phases(
    phases: Sequence[PhaseTrajectory], turns: int, times: int
) -> tuple[PhaseTrajectory, ...]:
    """The phases of `times` strides that each gain so many whole turns of theta."""
    shifts = [np.array([0.0, 2 * math.pi * turns * stride, 0.0, 0.0]) for stride in range(times)]
    return tuple(
        dataclasses.replace(phase, states=phase.states + shift)
        for shift in shifts
        for phase in phases
    )
