"""Recordings of walks, to be shown: where the wheel was at any time, and what it spent."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from agents.conditions import Conditions
from agents.policy_files import NamedPolicy
from agents.rollout import Interval, Rollout, at_rest
from rimless_gym.energy import CHANNELS
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA, hybrid_states
from rimless_gym.params import WheelParams
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


class Touchdown(NamedTuple):
    """The end of a step.

    Attributes:
        time: s.
        legs: by which the stance foot moved, positive: forward.
        foot: the new stance foot, counted in legs.
    """

    time: float
    legs: int
    foot: int


class Figures(NamedTuple):
    """Means over the last `STEPS` steps: speed (m/s), and cost of transport by E+."""

    speed: float
    cot: float


@dataclasses.dataclass(frozen=True)
class Recording:
    """A walk.

    Attributes:
        name: of the policy or the gait.
        params: the machine.
        begins: time of the first state (s).
        period: from state to state (s).
        states: (n + 1, STATE_SIZE).
        volts: held from each state to the next (V), (n,).
        sums: of the entries `SUMMED` from the beginning to each state, (n + 1, len(SUMMED)).
        touchdowns: in order of time.
    """

    name: str
    params: WheelParams
    begins: float
    period: float
    states: Floats
    volts: Floats
    sums: Floats
    touchdowns: tuple[Touchdown, ...]

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
