"""How far walks stay from the optimal cycle: their states less the optimum's, at equal phase."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agents.reports.charts import Axis, Chart, Series
from agents.rollout import Interval
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import MODE, THETA
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution

#: What is drawn: coordinate, its name, its unit, and how many of the unit are 1 rad or 1 rad/s.
DRAWN = (
    ("leg angle phi", "mrad", 1e3),
    ("pendulum angle theta", "mrad", 1e3),
    ("leg rate phi'", "mrad/s", 1e3),
    ("pendulum rate theta'", "mrad/s", 1e3),
)


class Step(NamedTuple):
    """What a walk does from one touchdown to the next.

    Attributes:
        phases: shares of the step's time at the ticks of the control within it, (K,).
        states: there, (K, 4).
    """

    phases: Floats
    states: Floats


class Deviation(NamedTuple):
    """How far a step is from that of a gait.

    Attributes:
        phases: shares of the step's time, (K,).
        states: the step's less the gait's, there, (K, 4).
    """

    phases: Floats
    states: Floats


def steps_of(walk: Iterable[Interval]) -> list[Step]:
    """The steps of the first of some walks, from its first touchdown to its last."""
    steps: list[Step] = []
    begin, times, states = None, list[float](), list[Floats]()
    for k, interval in enumerate(walk):
        if len(interval.running) == 0 or interval.running[0] != 0:
            break
        times.append(k * CONTROL_PERIOD)
        states.append(interval.states[0, :MODE])
        if interval.info["steps"][0] <= 0:
            continue
        end = times[-1] + float(interval.info["touchdown_time"][0])
        if begin is not None:
            phases = (np.array(times) - begin) / (end - begin)
            steps.append(Step(phases, np.array(states)))
        begin, times, states = end, [], []
    return steps


def deviations(steps: Sequence[Step], gait: Solution) -> list[Deviation]:
    """Deviations of consecutive steps from those of a gait, at equal shares of a step's time.

    Where the gait has several steps in a stride, the walk's first step is compared with the one
    that makes its deviations the smallest.
    """
    scale = gait.state(np.linspace(0.0, gait.duration, 200)).std(axis=0)
    orders = [_from(steps, gait, first) for first in range(gait.steps)]

    def size(order: list[Deviation]) -> float:
        return sum(float(np.sum((each.states / scale) ** 2)) for each in order)

    return min(orders, key=size)


def _from(steps: Sequence[Step], gait: Solution, first: int) -> list[Deviation]:
    found = []
    for i, step in enumerate(steps):
        phase = gait.phases[(first + i) % gait.steps]
        apart = step.states - phase.state(step.phases * phase.duration)
        turns = np.round(apart[:, THETA] / (2 * np.pi))
        apart[:, THETA] -= 2 * np.pi * turns
        found.append(Deviation(step.phases, apart))
    return found


def deviation_charts(
    found: Mapping[str, tuple[Sequence[Deviation], str]], where: str
) -> list[Chart]:
    """A chart for each coordinate.

    Args:
        found: name of a walk -> its deviations, and a colour.
        where: which optimum they deviate from, for the titles.
    """
    charts = []
    for i, (name, unit, scale) in enumerate(DRAWN):
        series = [
            Series(walk, *_joined(steps, i, scale), colour=colour, width=1.0)
            for walk, (steps, colour) in found.items()
        ]
        title = f"{name}, {where}"
        charts.append(Chart(title, Axis("share of the step"), Axis(f"deviation ({unit})"), series))
    return charts


def _joined(steps: Sequence[Deviation], coordinate: int, scale: float) -> tuple[Floats, Floats]:
    """All steps as one line that is interrupted between them."""
    x = [np.append(step.phases, np.nan) for step in steps]
    y = [np.append(scale * step.states[:, coordinate], np.nan) for step in steps]
    return np.concatenate(x), np.concatenate(y)
