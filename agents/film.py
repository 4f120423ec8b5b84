"""Walks, recorded and as pictures: one alone, or several on one ground with their energies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from agents.conditions import Conditions
from agents.policy_files import NamedPolicy
from agents.rollout import Interval, Rollout, at_rest
from rimless_gym.energy import CHANNELS
from rimless_gym.equations import LOSSES, SINGLE
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA, hybrid_states
from rimless_gym.params import WheelParams
from rimless_gym.rendering.canvas import FIRST, OPTIMUM, OTHERS, STANCE, Colour, Frame
from rimless_gym.rendering.panels import Shown, draw_several, draw_spending
from rimless_gym.rendering.wheel import Scene
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution

#: The entries of `info` that are summed.
SUMMED = ("distance", *(channel.name for channel in CHANNELS))

#: Those that make the energy drawn from a battery that cannot be recharged, E+.
DRAWN = ("electrical_positive", "idle")

#: Steps in a row over which speed and cost are averaged. Before them, there are no figures.
STEPS = 5

#: Time (s) after a touchdown in which the next one must follow.
PAUSE = 2.0

#: Over what speed and cost are averaged, in words.
AVERAGED = f"over {STEPS} steps"

#: Name of the gait whose ghost is blue.
GHOST = "optimum"

#: Steps by which it walks ahead of the first walk when it joins.
AHEAD = 2

#: Most walks in one picture.
MOST = 2 + len(OTHERS)

#: Letters of a name that are written; of a longer one its end, where paths differ.
LETTERS = 22

#: Width and height (pixels).
SIZE = (720, 468)

#: Share of the height that the walks take.
GROUND = 0.64

#: Title of the energies.
ENERGY = "energy since the start (J)"

#: Energies that are less in the end (J) are left out.
NOTHING = 1e-6


def times(ends: float, fps: float) -> list[float]:
    """When pictures are taken of a walk until it ends (s), one or more."""
    return [k / fps for k in range(max(1, round(ends * fps)))]


class GroupFilm:
    """Walks on one ground.

    Args:
        walks: the first is drawn solid, followed by the camera and measured; the others are ghosts,
            which appear when their recordings begin. `MOST` of them at most, of one machine.
        size: width and height in pixels.

    Attributes:
        size: as given.
        ends: when the last of them has ended (s).
    """

    def __init__(self, walks: Sequence[Recording], size: tuple[int, int] = SIZE) -> None:
        if len(walks) > MOST:
            raise ValueError(f"{len(walks)} walks: at most {MOST} fit into one picture")
        first = walks[0]
        for walk in walks:
            if walk.params != first.params:
                raise ValueError(
                    f"{walk.name}: walks with another machine than {first.name}: "
                    f"{walk.params.differences(first.params)}; watch them one at a time"
                )
        self.size = width, height = size
        self.ends = max(walk.ends for walk in walks)
        titled = [dataclasses.replace(walk, name=_title(walk.name)) for walk in walks]
        self._walks = list(zip(titled, _colours([walk.name for walk in walks]), strict=True))
        self._above = width, round(GROUND * height)
        self._below = width, height - self._above[1]
        spent = spending(first, first.ends)
        self._terms = [term for term, joules in spent.items() if abs(joules) > NOTHING]
        self._full = max(
            *accumulate(spent.values()), *(drawn(walk, walk.ends) for walk in walks), NOTHING
        )

    def frame(self, time: float) -> Frame:
        """The picture at a time (s), uint8 of shape (height, width, 3)."""
        first = self._walks[0][0]
        present = [(walk, colour) for walk, colour in self._walks if walk.begins <= time + 1e-9]
        shown = [
            Shown(name=walk.name, colour=colour, scene=walk.scene(time)) for walk, colour in present
        ]
        batteries = {"battery": (drawn(first, time), STANCE)}
        for walk, colour in present[1:]:
            if walk.begins <= first.begins:  # energies of a shorter walk do not compare
                batteries[f"battery, {walk.name}"] = drawn(walk, time), colour
        spent = spending(first, time)
        below = draw_spending(
            ENERGY, batteries, {term: spent[term] for term in self._terms}, self._full, self._below
        )
        lines = len(self._walks)
        ground = draw_several(first.params, shown, self._above, lines=lines, averaged=AVERAGED)
        return np.concatenate([ground, below])


def ghost(gait: Solution, first: Recording) -> Recording:
    """The optimum, in step with a walk: it joins at the touchdown from which that has figures.

    It begins `AHEAD` steps ahead, so that both are visible; with the walk if that has no figures.
    """
    joins = first.measured_from or Touchdown(0.0, 1, 0)
    return record_gait(GHOST, gait, first.ends, joins.time, joins.foot + AHEAD)


def _title(name: str) -> str:
    """A name as it is written: in one line, and short enough to leave room for the bars."""
    text = " ".join(name.split())
    return text if len(text) <= LETTERS else "..." + text[3 - LETTERS :]


def _colours(names: Sequence[str]) -> list[Colour]:
    """Colours of the first walk and of the ghosts."""
    others = iter((*OTHERS, OPTIMUM))
    return [FIRST, *(OPTIMUM if name == GHOST else next(others) for name in names[1:])]


def drawn(walk: Recording, time: float) -> float:
    """E+ up to a time (J): drawn from a battery that cannot be recharged."""
    spent = walk.spent(time)
    return sum(spent[name] for name in DRAWN)


def spending(walk: Recording, time: float) -> dict[str, float]:
    """Where that energy went (J), by term of the ledger; the sum of all is what was drawn.

    "not recharged" is what the motor gives back. What pushes give counts as negative.
    """
    sums = walk.spent(time)
    spent = {name: sums[name] for name in ("idle", *LOSSES, "collision")}
    spent["not recharged"] = sums["electrical_positive"] - sums["electrical"]
    return spent | {"push": -sums["push"], "change of mechanical energy": sums["mechanical_change"]}


class Touchdown(NamedTuple):
    """The end of a step."""

    time: float  # s
    legs: int  # by which the stance foot moved, positive: forward
    foot: int  # the new stance foot, counted in legs


class Figures(NamedTuple):
    """Means over the last `STEPS` steps: speed (m/s), and cost of transport by E+."""

    speed: float
    cot: float


@dataclasses.dataclass(frozen=True)
class Recording:
    """A walk."""

    name: str  # of the policy or the gait
    params: WheelParams  # the machine
    begins: float  # time of the first state (s)
    period: float  # from state to state (s)
    states: Floats  # (n + 1, STATE_SIZE)
    volts: Floats  # held from each state to the next (V), (n,)
    sums: Floats  # of the entries `SUMMED` from the beginning to each state, (n + 1, len(SUMMED))
    touchdowns: tuple[Touchdown, ...]  # in order of time

    @property
    def ends(self) -> float:
        """Time of the last state (s)."""
        return self.begins + len(self.volts) * self.period

    def index(self, time: float) -> int:
        """Index of the last state at or before a time (s), or the nearest one outside the walk."""
        k = math.floor((time - self.begins) / self.period + 1e-6)
        return min(max(k, 0), len(self.volts))

    def pose(self, time: float) -> Scene:
        """Where the wheel is at a time (s)."""
        k = self.index(time)
        state = self.states[k]
        return Scene(
            phi=float(state[PHI]),
            theta=float(state[THETA]),
            mode=int(state[MODE]),
            foot_x=float(state[FOOT]) * self.params.step_length,
            voltage=float(self.volts[min(k, len(self.volts) - 1)]),
            time=time,
        )

    def scene(self, time: float) -> Scene:
        """The pose, with speed and cost where there are figures."""
        figures, pose = self.figures(time), self.pose(time)
        return dataclasses.replace(pose, **figures._asdict()) if figures else pose

    @cached_property
    def measured_from(self) -> Touchdown | None:
        """The touchdown from which on there are `figures`; None if there never are any."""
        return next((end for end in self.touchdowns if self.figures(end.time)), None)

    def figures(self, time: float) -> Figures | None:
        """Means over the last `STEPS` steps before a time (s).

        None where there were not as many in a row, all forward and none long ago.
        """
        ends = [touchdown for touchdown in self.touchdowns if touchdown.time <= time]
        ends = ends[-STEPS - 1 :]
        times = [end.time for end in ends]
        waits = np.diff([*times, time])
        if len(ends) <= STEPS or any(end.legs != 1 for end in ends) or waits.max() > PAUSE:
            return None
        distance, energy = (self._between(names, times) for names in (("distance",), DRAWN))
        return Figures(distance / (times[-1] - times[0]), energy / (self.params.weight * distance))

    def spent(self, time: float) -> dict[str, float]:
        """Sums of the entries `SUMMED` from the beginning to a time (s)."""
        return dict(zip(SUMMED, self.sums[self.index(time)].tolist(), strict=True))

    def _between(self, names: Iterable[str], times: list[float]) -> float:
        """The sum of some entries between the first and the last of some times."""
        sums = sum(self.sums[:, SUMMED.index(name)] for name in names)
        clock = self.begins + self.period * np.arange(len(self.sums))
        return float(np.diff(np.interp([times[0], times[-1]], clock, sums))[0])


def record(name: str, walk: Iterable[Interval], params: WheelParams, period: float) -> Recording:
    """A recording of the first of some walks, whose intervals last `period` (s)."""
    intervals = list(walk)
    states = np.stack([*(each.states[0] for each in intervals), intervals[-1].after[0]])
    volts = params.voltage_limit * np.array([float(each.actions[0]) for each in intervals])
    touchdowns = tuple(
        Touchdown(
            k * period + float(each.info["touchdown_time"][0]),
            int(each.info["steps"][0]),
            int(each.after[0, FOOT]),
        )
        for k, each in enumerate(intervals)
        if each.info["touchdowns"][0]
    )
    return Recording(name, params, 0.0, period, states, volts, _summed(intervals), touchdowns)


def record_policy(policy: NamedPolicy, seconds: float, command: float | None = None) -> Recording:
    """A recording of a walk from rest until it falls, `seconds` long to the nearest interval.

    The commanded speed, if any, is in m/s.
    """
    n_intervals = max(1, round(seconds / policy.period))
    start = at_rest(policy.params)[None]
    walk = Rollout(policy.conditions, policy.policy, start, n_intervals, command=command)
    return record(policy.name, walk, policy.params, policy.period)


def record_gait(
    name: str, gait: Solution, seconds: float, begins: float = 0.0, legs: int = 0
) -> Recording:
    """A held gait as it was solved, stride after stride, until `seconds`.

    Its first stride begins at the time `begins` (s) on foot `legs`, counted in legs. Its energies
    are those of a stride in the environment.
    """
    hold = _period(gait)
    first = math.ceil(begins / hold - 1e-6)
    clock = hold * np.arange(first, max(round(seconds / hold), first + 1) + 1)
    since = np.maximum(clock - begins, 0.0)
    states = hybrid_states(gait.state(since), SINGLE)
    states[:, FOOT] = legs + gait.foot(since)
    strides = gait.duration * np.arange(int(since[-1] / gait.duration) + 1)
    ends = (strides[:, None] + gait.phase_times[:-1]).ravel()
    ends = ends[ends <= since[-1]]
    feet = legs + np.arange(len(ends))
    touchdowns = tuple(
        Touchdown(time, 1, foot)
        for time, foot in zip((begins + ends).tolist(), feet.tolist(), strict=True)
    )
    volts = np.asarray(gait.control(since[:-1]))
    return Recording(
        name, gait.params, float(clock[0]), hold, states, volts, _spent(gait, since), touchdowns
    )


def _spent(gait: Solution, times: Floats) -> Floats:
    """What a gait has spent at times since its touchdown (s), (N, len(SUMMED)), 0 at the first."""
    volts, first = gait.held_voltages, gait.first_tick
    start = hybrid_states(gait.state([first]), SINGLE)
    played = iter(volts / gait.params.voltage_limit)

    def repeated(states: Floats, observations: object) -> Floats:
        return np.array([next(played)])

    walk = Rollout(Conditions(gait.params), repeated, start, len(volts))
    stride = _summed(walk)
    ticks = _period(gait) * np.arange(len(volts) + 1)
    strides, within = np.divmod(times - first, gait.duration)
    columns = [np.interp(within, ticks, column) for column in stride.T]
    sums = np.stack(columns, axis=1) + strides[:, None] * stride[-1]
    return np.asarray(sums - sums[0])


def _period(gait: Solution) -> float:
    """Period of the clock that holds the gait's voltage (s)."""
    return gait.duration / len(gait.held_voltages)


def _summed(intervals: Iterable[Interval]) -> Floats:
    """Sums of the first walk up to the ends of each interval, (n + 1, len(SUMMED))."""
    spent = [[float(each.info[name][0]) for name in SUMMED] for each in intervals]
    return np.concatenate([np.zeros((1, len(SUMMED))), np.cumsum(spent, axis=0)])
