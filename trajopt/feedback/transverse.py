"""The linear dynamics across a gait's orbit under a zero-order hold, touchdowns included."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import advance, hybrid_states
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import FINENESS, Grid

#: Of the central differences (rad, rad/s, V).
DIFFERENCE = 1e-6


class Transverse(NamedTuple):
    """From every time of a `Grid` to the one a period later, in coordinates of the orbit.

    The first three coordinates lie across the orbit, in standard deviations of the gait's own
    motion. The last one is the time by which the state is ahead (s).

    Attributes:
        A: shape (m, 4, 4): of the deviation, under the gait's voltage at the nearest point.
        B: shape (m, 4, 1): of what is added to that voltage (1/V).
        into: deviations (m, 4) to coordinates: shape (m, 4, 4).
    """

    A: Floats
    B: Floats
    into: Floats

    def per_deviation(self, rows: Floats) -> Floats:
        """Rows (m, 4) per coordinate across the orbit as rows (m, 4) per deviation of the state.

        What they say of the time ahead is left out.
        """
        return np.asarray(np.einsum("jk,jkc->jc", rows[:, :3], self.into[:, :3]))


def transverse_dynamics(grid: Grid) -> Transverse:
    """The dynamics across the orbit."""
    pairs = [coordinates(tangent, grid.metric) for tangent in grid.tangents]
    into, out = (np.array(each) for each in zip(*pairs, strict=True))
    A, B = held_dynamics(grid.solution.params, grid.states, grid.voltages, grid.period)
    later = np.roll(into, -FINENESS, axis=0)
    A, B = later @ A @ out, later @ B
    A[:, :, 3] += B[:, :, 0] * grid.voltage_rates[:, None]  # a state that is ahead plays V* ahead
    return Transverse(A, B, into)


def held_dynamics(
    params: WheelParams, states: Floats, voltages: Floats, period: float
) -> tuple[Floats, Floats]:
    """Derivatives of the state after a held period: A (n, 4, 4) by the state, B (n, 4, 1) by V.

    Central differences of the stepping kernel. It locates touchdowns exactly, so a period that
    contains one is differentiated like any other.
    """
    columns = []
    for i in range(5):
        ends = []
        for sign in (1.0, -1.0):
            batch, volts = hybrid_states(states, SINGLE), voltages.copy()
            if i < 4:
                batch[:, i] += sign * DIFFERENCE
            else:
                volts += sign * DIFFERENCE
            advance(params, batch, volts, period, pull=math.inf)
            ends.append(batch[:, :4])
        columns.append((ends[0] - ends[1]) / (2 * DIFFERENCE))
    jacobian = np.stack(columns, axis=2)
    return jacobian[:, :, :4], jacobian[:, :, 4:]


def coordinates(tangent: Floats, metric: Floats) -> tuple[Floats, Floats]:
    """Into the coordinates of `Transverse` and out of them, (4, 4) both.

    The first three columns of `out` are orthogonal to the tangent in the metric.
    """
    scale = np.sqrt(metric)
    unit = scale * tangent / np.linalg.norm(scale * tangent)
    basis = np.linalg.qr(np.column_stack([unit, np.eye(4)]))[0][:, 1:]
    out = np.column_stack([basis / scale[:, None], tangent])
    return np.linalg.inv(out), out
