"""Guesses for a problem of which no solution is known: straight lines, and random ones."""

from __future__ import annotations

import dataclasses
from typing import TypeAlias

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import pair
from trajopt.ocp.layout import middles
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.scaling import PhaseScales, implied_durations, scales_of
from trajopt.ocp.trajectory import PhaseTrajectory

#: One trajectory per phase, on any mesh.
Guess: TypeAlias = tuple[PhaseTrajectory, ...]


def straight_lines(problem: Problem) -> Guess:
    """States on straight lines from the middle of the start's bounds to the middle of the end's.

    A state that is free at one end has the value of the other end; if it is free at both, 0.
    Controls are in the middle of their bounds. Durations are equal shares of the total, if that is
    bounded, or else what the differential equations imply for such states and controls (or 1 s, if
    that is nothing), each moved into its own bounds.
    """
    phases = []
    for phase in problem.phases:
        first, last = (middles(*phase.state_bounds(where)) for where in ("start", "end"))
        first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
        control = np.nan_to_num(middles(*phase.control_bounds()))
        phases.append(line(np.nan_to_num(first), np.nan_to_num(last), control, 1.0))
    _, high = pair(problem.duration)
    wanted = np.full(len(phases), high / len(phases))
    limits = np.array([pair(phase.duration) for phase in problem.phases])
    if not np.isfinite(high) and np.ptp(limits, axis=1).any():
        wanted = np.nan_to_num(implied_durations(problem, phases), nan=1.0)
    durations = np.clip(wanted, *limits.T)
    return tuple(
        dataclasses.replace(path, edges=T * path.edges)
        for path, T in zip(phases, durations.tolist(), strict=True)
    )


@dataclasses.dataclass(frozen=True)
class Waypoints:
    """Random guesses by index, as `trajopt.multi_start` takes them.

    Guess 0 is `straight_lines`. The others are straight lines from the start through random points
    to the end, of random durations.

    Attributes:
        problem: what the guesses are for.
        points: how many points there are at most.
        spread: how far points may lie from the start, on a side without a bound, relative to the
            distance from start to end (to its scale along `straight_lines`, if that is less).
    """

    problem: Problem
    points: int = 3
    spread: float = 1.0

    def __call__(self, rng: np.random.Generator, index: int) -> Guess:
        """Guess number `index`."""
        lines = straight_lines(self.problem)
        if index == 0:
            return lines
        scales = scales_of(self.problem, lines).phases
        each = zip(self.problem.phases, lines, scales, strict=True)
        return tuple(self.varied(*phase, rng) for phase in each)

    def varied(
        self,
        phase: Phase,
        trajectory: PhaseTrajectory,
        scales: PhaseScales,
        rng: np.random.Generator,
    ) -> PhaseTrajectory:
        """A straight line bent through random points."""
        count = int(rng.integers(1, self.points, endpoint=True))
        knots = np.array([0.0, *np.sort(rng.uniform(0.1, 0.9, count)), 1.0])
        times = trajectory.duration * knots
        values = np.hstack([trajectory.state(times), trajectory.control(times)])
        both = zip(phase.state_bounds(), phase.control_bounds(), strict=True)
        lower, upper = (np.concatenate(side) for side in both)
        least_width = np.concatenate([scales.states, scales.controls])
        width = self.spread * np.maximum(np.abs(values[-1] - values[0]), least_width)
        low = np.where(np.isfinite(lower), lower, np.minimum(values[0], upper) - width)
        high = np.where(np.isfinite(upper), upper, np.maximum(values[0], lower) + width)
        values[1:-1] = rng.uniform(low, high, (count, len(low)))
        least, most = pair(phase.duration)
        if np.isfinite(most):
            duration = float(rng.uniform(least, most))
        else:  # up to e times as long, or as short
            duration = max(least, trajectory.duration * float(np.exp(rng.uniform(-1.0, 1.0))))
        return _joined(duration * knots, values, len(phase.states))


def _joined(t: Array, values: Array, states: int) -> PhaseTrajectory:
    """Straight lines between values at times t (N,): so many columns of states, then controls."""
    ends = np.array([0.0, 1.0])
    pieces = np.stack([values[:-1], values[1:]], axis=1)
    return PhaseTrajectory(t, ends, pieces[..., :states], ends, pieces[..., states:])


def line(first: Array, last: Array, control: Array, duration: float) -> PhaseTrajectory:
    """A straight line between two states in `duration` (s), at constant control."""
    ends = np.array([0.0, 1.0])
    controls = np.tile(control, (1, 2, 1))
    return PhaseTrajectory(duration * ends, ends, np.stack([first, last])[None], ends, controls)


def polyline(t: Array, x: Array, controls: int = 1) -> PhaseTrajectory:
    """Straight lines between states x (N, nx) at times t (N,), with controls of 0."""
    return _joined(t, np.hstack([x, np.zeros((len(t), controls))]), x.shape[1])
