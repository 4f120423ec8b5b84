"""A held gait stepped on the kernel, interval by interval, as the environment steps it."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import bmat, eye
from scipy.sparse.linalg import spsolve

from rimless_gym.energy import ROW, Ledger
from rimless_gym.hybrid import CONTROL_PERIOD, Failure
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.params import WheelParams
from trajopt.ocp.arrays import Array

#: Of the central differences (rad, rad/s).
DIFFERENCE = 1e-7

#: Newton steps at most, and the mismatch (rad, rad/s) at which they end.
NEWTON_STEPS, SMALL = 12, 1e-13


class Held(NamedTuple):
    """A stride under a clock.

    Attributes:
        params: the machine.
        hold: s.
        voltages: of the intervals from one tick to the next (V), shape (ticks,).
        theta_turns: whole turns that theta gains.
    """

    params: WheelParams
    hold: float
    voltages: Array
    theta_turns: int

    @property
    def shift(self) -> Array:
        """By how much the state at the end differs from that at the start, shape (4,)."""
        return np.array([0.0, 2 * math.pi * self.theta_turns, 0.0, 0.0])


@dataclasses.dataclass(frozen=True)
class Replay:
    """A stride on the kernel.

    Attributes:
        states: at the ticks, before any interval and after all, shape (ticks + 1, 4).
        touchdown_times: of the last touchdown in each interval, from its start (s), or -1, shape
            (ticks,).
        touchdowns: how many in all.
        ledger: of all intervals.
        failure: of the interval that ended early, or `Failure.NONE`.
    """

    states: Array
    touchdown_times: Array
    touchdowns: int
    ledger: Ledger
    failure: Failure


def replayed(held: Held, start: Array) -> Replay:
    """A stride from a state (4,) at a tick, in single stance."""
    state = _at(start[None])
    states, rows = [start], []
    for volts in held.voltages:
        rows.append(_advance(held.params, state, np.array([volts]), held.hold)[0])
        states.append(state[0, :4].copy())
    table = np.array(rows)
    return Replay(
        np.array(states),
        table[:, ROW.touchdown_time],
        int(table[:, ROW.touchdowns].sum()),
        Ledger.from_rows(table.sum(axis=0), held.params),
        Failure(int(table[:, ROW.failure].max())),
    )


def repeating(held: Held, states: Array) -> Array:
    """The states at the ticks of the stride that repeats itself under the held voltages.

    Newton's method on all intervals at once. A stride magnifies deviations, so solving for its
    start alone would not converge.

    Args:
        held: the voltages.
        states: near the solution, at the ticks before each interval, shape (ticks, 4).

    Returns:
        Shape (ticks, 4); not a solution if Newton's method did not converge.
    """
    for _ in range(NEWTON_STEPS):
        ends, slopes = _ends(held, states), _slopes(held, states)
        gaps = ends - np.roll(states, -1, axis=0)
        gaps[-1] -= held.shift
        if not np.isfinite(gaps).all() or np.abs(gaps).max() < SMALL:
            break
        states = states + _corrections(slopes, gaps)
    return states


def _corrections(slopes: Array, gaps: Array) -> Array:
    """The changes dx of the states with dx of the next = slope dx + gap, cyclically."""
    n = len(gaps)
    blocks: list[list[object]] = [[None] * n for _ in range(n)]
    for k in range(n):
        blocks[k][k] = slopes[k]
        blocks[k][(k + 1) % n] = -eye(4)
    return np.asarray(spsolve(bmat(blocks, format="csc"), -gaps.ravel())).reshape(n, 4)


def _slopes(held: Held, states: Array) -> Array:
    """Derivatives of each interval's end by its start, shape (ticks, 4, 4)."""
    columns = []
    for i in range(4):
        nudge = np.zeros(4)
        nudge[i] = DIFFERENCE
        columns.append(
            (_ends(held, states + nudge) - _ends(held, states - nudge)) / (2 * DIFFERENCE)
        )
    return np.stack(columns, axis=2)


def _ends(held: Held, states: Array) -> Array:
    """Where each interval leads from its own start, shape (ticks, 4)."""
    return after(held, states, held.hold)


def after(held: Held, states: Array, duration: float) -> Array:
    """Where each interval's voltage leads from a state at its start in a duration, (ticks, 4)."""
    batch = _at(states)
    _advance(held.params, batch, held.voltages, duration)
    return batch[:, :4].copy()


def _at(states: Array) -> Array:
    """Hybrid states in single stance on foot 0."""
    batch = np.zeros((len(states), STATE_SIZE))
    batch[:, :4] = states
    return batch


def _advance(params: WheelParams, batch: Array, voltages: Array, duration: float) -> Array:
    """Advance hybrid states in place, by the environment's intervals if it is longer; its rows."""
    pieces = max(1, math.ceil(duration / CONTROL_PERIOD - 1e-9))
    rows = [advance(params, batch, voltages, duration / pieces) for _ in range(pieces)]
    total = np.sum(rows, axis=0)
    times = np.array([row[:, ROW.touchdown_time] for row in rows])
    offsets = duration / pieces * np.arange(pieces)[:, None]
    total[:, ROW.touchdown_time] = np.where(times >= 0.0, times + offsets, -1.0).max(axis=0)
    total[:, ROW.failure] = np.max([row[:, ROW.failure] for row in rows], axis=0)
    return np.asarray(total)
