"""A gait's orbit as a table, and where on it a state is: its phase.

The orbit is kept at nodes a fraction of a control period apart. The phase of a state is the nearest
point of the polyline through them, in a metric in which all four coordinates vary alike along the
gait. Near the gait it moves continuously from node to node; far away, where two points of the orbit
are equally near, it jumps. Only the deviation across the orbit is an error; to
be early or late is none (Shiriaev, Freidovich and Gusev, IEEE TAC 2010, for transverse
coordinates).

The voltage of a held gait changes at ticks, and the gait is optimal only in step with them. How far
a state is ahead of this clock is one more coordinate, which some laws correct. They need no memory
for it: the clock is the control period, at whose ends they act. So only a gait that is held for a
control period has a clock; where the voltage is continuous, or held for another time, to be ahead
costs nothing.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import positive, require_kind
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import cached, inner
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution

#: Nodes per control period: the polyline is then within 1e-4 standard deviations of the orbit.
FINENESS = 16

#: The nearest node is searched among every so many, and then around the best of these.
SKIPPED = 8

#: Fewest control periods in a stride, so that neighbours of a very short one are near.
FEWEST_PERIODS = 8

#: Weight of the pendulum's angle where it turns over (1/rad^2): its variance means nothing there.
TURNING_WEIGHT = 0.5


class Orbit(NamedTuple):
    """A gait as a table of n nodes."""

    states: Floats  # shape (n, 4); a touchdown has two nodes, one before it and one after
    times: Floats  # from the stride's start (s), shape (n,)
    voltages: Floats  # means over a control period from the node on (V), shape (n,)
    continued: NDArray[np.bool_]  # whether the next node lies on the same step, shape (n,)
    metric: Floats  # weights of the squared coordinates in the distance from the orbit, shape (4,)
    limit: float  # largest voltage (V)


class Spot(NamedTuple):
    """Where on an orbit a state is."""

    node: int  # the node behind it
    share: float  # of the way to the next node, from 0 to 1
    squared: float  # the squared distance from the orbit, in its metric


@dataclasses.dataclass(frozen=True)
class Grid:
    """Times evenly spread over a stride, away from its touchdowns, and all nodes of its orbit."""

    solution: Solution  # the gait
    # time in which it passes `FINENESS` of the times (s): about a control period, but at most the
    # share 1 / `FEWEST_PERIODS` of the stride
    period: float
    times: Floats  # s, shape (m,)

    @classmethod
    def of(cls, solution: Solution) -> Grid:
        """The grid of a gait; a ValueError if it failed its verification, or stops on two feet."""
        require_kind("solution", solution, Solution)
        if solution.double_stance:
            raise ValueError(
                "solution: it stops on two feet, where no law can hold it; solve for a gait "
                "without `double_stance`"
            )
        if not solution.verification.passed:
            raise ValueError(
                f"solution: failed its verification ({'; '.join(solution.verification.failures)}), "
                "so no law can hold it; solve it again, with `starts` or at another speed"
            )
        periods = max(FEWEST_PERIODS, round(solution.duration / CONTROL_PERIOD - 1e-6))
        m = FINENESS * periods
        spacing = solution.duration / m
        shift = _clearest(np.asarray(solution.phase_times) / spacing)
        times = np.asarray(spacing * (np.arange(m) + shift), dtype=np.float64)
        return cls(solution, FINENESS * spacing, times)

    @cached_property
    def states(self) -> Floats:
        """At the times, shape (m, 4)."""
        return np.asarray(self.solution.state(self.times))

    @cached_property
    def voltages(self) -> Floats:
        """Means over a period from the times on (V), shape (m,)."""
        return mean_voltage(self.solution, self.times, self.period)

    @cached_property
    def voltage_rates(self) -> Floats:
        """Rates of `voltages` along the orbit (V/s), shape (m,)."""
        around = np.concatenate([self.voltages[-1:], self.voltages, self.voltages[:1]])
        return np.asarray(np.gradient(around)[1:-1] * FINENESS / self.period)

    @cached_property
    def tangents(self) -> Floats:
        """Rates of the state along the orbit at the times, shape (m, 4)."""
        flow = HybridModel(self.solution.params).functions["flow"].map(len(self.times))
        return np.asarray(flow(self.states.T, self.solution.control(self.times)[None])).T

    @cached_property
    def metric(self) -> Floats:
        """Weights of the squared coordinates, shape (4,)."""
        metric: Floats = 1.0 / np.var(self.states, axis=0)
        if self.solution.theta_turns:
            metric[1] = TURNING_WEIGHT
        return metric

    def orbit(self) -> Orbit:
        """The table: the times' nodes, and two at every touchdown."""
        states, times, continued = [], [], []
        for i, phase in enumerate(self.solution.phases):
            begin, end = self.solution.phase_times[i : i + 2]
            inside = (self.times > begin) & (self.times < end)
            times += [begin, *self.times[inside], end]
            states += [phase.states[0, 0], *self.states[inside], phase.states[-1, -1]]
            continued += [True] * (inside.sum() + 1) + [False]
        t = np.array(times)
        voltages = mean_voltage(self.solution, t, self.period)
        limit = self.solution.params.voltage_limit
        return Orbit(np.array(states), t, voltages, np.array(continued), self.metric, limit)

    def at_nodes(self, values: Floats) -> Floats:
        """Values (m, ...) at the times as values at the orbit's nodes.

        At a touchdown, the line through the two nearest times of the same step is drawn out.
        """
        rows = []
        for begin, end in pairwise(self.solution.phase_times):
            inside = np.flatnonzero((self.times > begin) & (self.times < end))
            first, last = values[inside[:2]], values[inside[-2:]]
            t, u = self.times[inside[:2]], self.times[inside[-2:]]
            at_begin = first[0] + (begin - t[0]) / (t[1] - t[0]) * (first[1] - first[0])
            at_end = last[1] + (end - u[1]) / (u[1] - u[0]) * (last[1] - last[0])
            rows += [at_begin, *values[inside], at_end]
        return np.array(rows)


def _clearest(touchdowns: Floats) -> float:
    """The shift of a grid of spacing 1, in [0, 1), that keeps its points away from touchdowns."""
    shifts = (np.arange(20) + 0.5) / 20
    gaps = np.abs((touchdowns[:, None] - shifts + 0.5) % 1.0 - 0.5).min(axis=0)
    return float(shifts[np.argmax(np.round(gaps, 6))])


def mean_voltage(solution: Solution, t: Floats, period: float) -> Floats:
    """Mean of the gait's voltage over [t, t + period], shape (N,).

    It is the constant voltage nearest to it in that interval.
    """
    knots = np.concatenate([[0.0], solution.breakpoints])
    sums = np.cumsum([0.0, *_integrals(solution, knots[:-1], knots[1:])])

    def integral(times: Floats) -> Floats:
        """From the stride's start (V s)."""
        strides, within = np.divmod(times, solution.duration)
        last = np.searchsorted(knots, within, side="right") - 1
        last = np.minimum(last, len(knots) - 2)
        rest = _integrals(solution, knots[last], within)
        return np.asarray(strides * sums[-1] + sums[last] + rest)

    return (integral(t + period) - integral(t)) / period


def _integrals(solution: Solution, begins: Floats, ends: Floats) -> Floats:
    """Integrals (V s) of the voltage between times without a breakpoint between them, (N,)."""
    s, weights = np.polynomial.legendre.leggauss(16)
    half = 0.5 * (ends - begins)
    times = begins[:, None] + half[:, None] * (s + 1)
    return np.asarray(half * (solution.control(times.ravel()).reshape(times.shape) @ weights))


@inner
def deviation(x, state):  # type: ignore[no-untyped-def]
    """x - state, the pendulum's angle by the shorter way round."""
    turn = x[1] - state[1]
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    return x[0] - state[0], turn, x[2] - state[2], x[3] - state[3]


@inner
def weighed(one, other, metric):  # type: ignore[no-untyped-def]
    """The product of two deviations in a metric."""
    return (
        metric[0] * one[0] * other[0]
        + metric[1] * one[1] * other[1]
        + metric[2] * one[2] * other[2]
        + metric[3] * one[3] * other[3]
    )


@inner
def located(x, orbit):  # type: ignore[no-untyped-def]
    """The `Spot` of a state: the nearest point of the segments beside the nearest node."""
    n, best, near = len(orbit.states), np.inf, 0
    for i in range(0, n, SKIPPED):
        d = deviation(x, orbit.states[i])
        distance = weighed(d, d, orbit.metric)
        if distance < best:
            best, near = distance, i
    j = near
    for i in range(max(near - SKIPPED + 1, 0), min(near + SKIPPED, n)):
        d = deviation(x, orbit.states[i])
        distance = weighed(d, d, orbit.metric)
        if distance < best:
            best, j = distance, i
    ahead = on_segment(x, orbit, j) if orbit.continued[j] else Spot(j, 0.0, best)
    if j == 0 or not orbit.continued[j - 1]:
        return ahead
    behind = on_segment(x, orbit, j - 1)
    return behind if behind.squared < ahead.squared else ahead


@inner
def on_segment(x, orbit, i):  # type: ignore[no-untyped-def]
    """The nearest point between node i and the next one."""
    ahead = deviation(orbit.states[i + 1], orbit.states[i])
    d = deviation(x, orbit.states[i])
    share = weighed(d, ahead, orbit.metric) / weighed(ahead, ahead, orbit.metric)
    share = min(max(share, 0.0), 1.0)
    e0, e1 = d[0] - share * ahead[0], d[1] - share * ahead[1]
    e2, e3 = d[2] - share * ahead[2], d[3] - share * ahead[3]
    rest = (e0, e1, e2, e3)
    return Spot(i, share, weighed(rest, rest, orbit.metric))


@inner
def between(values, spot):  # type: ignore[no-untyped-def]
    """A row of a table at a spot: linear between the nodes around it."""
    i = spot.node
    following = min(i + 1, len(values) - 1)
    return values[i] + spot.share * (values[following] - values[i])


@cached()
def squared_distances(x, orbit):  # type: ignore[no-untyped-def]
    """Squared distances of states (N, 4) from an orbit, (N,)."""
    squares = np.empty(len(x))
    for i in range(len(x)):
        squares[i] = located(x[i], orbit).squared
    return squares


class Clock(NamedTuple):
    """Ticks at tick + k `CONTROL_PERIOD` of the gait's own time, for all whole k."""

    tick: float  # time of one tick (s)
    # time (s) ahead of a tick that counts like one standard deviation of the gait's own motion;
    # infinite without a clock: time does not count
    ahead: float

    @classmethod
    def of(cls, solution: Solution, ahead: float | None) -> Clock:
        """The clock of a gait; with `ahead` = None time does not count, as if it had none."""
        counts = math.inf if ahead is None else positive("ahead", ahead)
        return cls(solution.first_tick, counts) if has_clock(solution) else cls(0.0, math.inf)


def has_clock(solution: Solution) -> bool:
    """Whether the gait's voltage is held for a control period."""
    return solution.hold is not None and math.isclose(solution.hold, CONTROL_PERIOD)


class Offset(NamedTuple):
    """How far from a held gait a state is."""

    spot: Spot  # the nearest point of the orbit
    across: tuple[float, float, float, float]  # deviation from that point, four numbers
    early: float  # time (s) by which that point is ahead of the nearest tick


@inner
def offset(x, orbit, clock):  # type: ignore[no-untyped-def]
    """The `Offset` of a state."""
    spot = located(x, orbit)
    across = deviation(x, between(orbit.states, spot))
    # A sine, which is the time near a tick and has no jump half way between two.
    turn = 2 * np.pi / CONTROL_PERIOD
    early = np.sin(turn * (between(orbit.times, spot) - clock.tick)) / turn
    return Offset(spot, across, early)
