"""Guesses for a problem about which nothing is known."""

from __future__ import annotations

import numpy as np

from trajopt.problem import Array, Problem, pair
from trajopt.trajectory import PhaseTrajectory


def straight_lines(problem: Problem) -> tuple[PhaseTrajectory, ...]:
    """States on straight lines from the middle of the start's bounds to that of the end's.

    A state that is free at an end keeps the value of the other end, or 0. Controls are in the
    middle of their bounds; durations are 1 s, or the nearest that their bounds allow.
    """
    phases = []
    low, high = pair(problem.duration)
    share = 1.0 if not np.isfinite(high) else high / len(problem.phases)
    for phase in problem.phases:
        least, most = pair(phase.duration)
        T = min(max(share if low > 0 or np.isfinite(high) else 1.0, least), most)
        first, last = (middles(*phase.state_bounds(where)) for where in ("start", "end"))
        first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
        control = np.nan_to_num(middles(*phase.control_bounds()))
        phases.append(line(np.nan_to_num(first), np.nan_to_num(last), control, T))
    return tuple(phases)


def line(first: Array, last: Array, control: Array, duration: float) -> PhaseTrajectory:
    """A straight line between two states in `duration` (s), at constant control."""
    ends = np.array([0.0, 1.0])
    controls = np.tile(control, (1, 2, 1))
    return PhaseTrajectory(duration * ends, ends, np.stack([first, last])[None], ends, controls)


def polyline(t: Array, x: Array, controls: int = 1) -> PhaseTrajectory:
    """States x (N, nx) at times t (N,), joined by straight lines; controls of 0."""
    ends = np.array([0.0, 1.0])
    states = np.stack([x[:-1], x[1:]], axis=1)
    return PhaseTrajectory(t, ends, states, ends, np.zeros((len(t) - 1, 2, controls)))


def middles(lower: Array, upper: Array) -> Array:
    """Middles of bounds (n,); NaN where there is no finite one."""
    both = np.isfinite(lower) & np.isfinite(upper)
    one = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper, np.nan))
    return np.where(both, 0.5 * (np.where(both, lower, 0.0) + np.where(both, upper, 0.0)), one)
