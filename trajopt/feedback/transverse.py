"""The linear dynamics across a gait's orbit under a zero-order hold, touchdowns included.

The gains of the periodic discrete-time LQR of these deviations follow from a Riccati recursion
(Bittanti, Colaneri and De Nicolao, The Riccati Equation, 1991), and the multipliers of a law from a
product over a stride.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import advance, hybrid_states
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats, Law, require_machine
from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.gaits.solution import Solution

#: Of the central differences (rad, rad/s, V).
DIFFERENCE = 1e-6

#: Most rounds of the Riccati recursion, and the change, relative to the largest cost to go, at
#: which it has converged.
ROUNDS, CONVERGED = 200, 1e-9


class Transverse(NamedTuple):
    """From every time of a `Grid` to the one a period later, in coordinates of the orbit.

    The first three coordinates lie across the orbit, in standard deviations of the gait's own
    motion. The last one is the time by which the state is ahead (s).
    """

    A: Floats  # shape (m, 4, 4): of the deviation, under the gait's voltage at the nearest point
    B: Floats  # shape (m, 4, 1): of what is added to that voltage (1/V)
    into: Floats  # deviations (m, 4) to coordinates: shape (m, 4, 4)

    def per_deviation(self, rows: Floats) -> Floats:
        """Rows (m, 4) per coordinate across the orbit as rows (m, 4) per deviation of the state.

        Their last column, of the time ahead, is left out.
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


class Optimal(NamedTuple):
    """The LQR at the m times of a `trajopt.feedback.orbit.Grid`, in coordinates of `Transverse`."""

    # (r + B' P B)^-1 B' P A of the period that begins at a time, with its cost r of a squared volt:
    # volts per coordinate, shape (m, 4)
    gains: Floats
    # (r + B' P B)^-1 B' P of the period that ends at a time: volts per coordinate, shape (m, 4)
    surface: Floats
    to_go: Floats  # cost to go P, shape (m, 4, 4): y' to_go y


def riccati(transverse: Transverse, effort: float, ahead: float) -> Optimal:
    """Gains and cost to go that minimise the sum of |y|^2 + effort v^2 over all time.

    y is the deviation in coordinates of `Transverse`, with its time in units of `ahead`, and v is
    added to the gait's voltage. A period leads from a time to the `FINENESS`th after it, so that
    there are as many interleaved recursions.

    Where `ahead` is infinite, time does not count. No convergence after `ROUNDS` strides is a
    RuntimeError.
    """
    A, B, cost = transverse.A, transverse.B, weights(ahead)
    if math.isinf(ahead):
        A, B, cost = A[:, :3, :3], B[:, :3], cost[:3, :3]
    m, n = A.shape[:2]
    ends, P = np.zeros((m, 1, n)), np.tile(cost, (FINENESS, 1, 1))
    to_go = np.empty((m, n, n))
    for _ in range(ROUNDS):
        last = P
        for begin in range(m - FINENESS, -1, -FINENESS):
            each = slice(begin, begin + FINENESS)
            A_, B_ = A[each], B[each]
            BP = B_.swapaxes(1, 2) @ P
            ends[each] = BP / (effort + BP @ B_)
            P = cost + A_.swapaxes(1, 2) @ P @ (A_ - B_ @ (ends[each] @ A_))
            P = 0.5 * (P + P.swapaxes(1, 2))
            to_go[each] = P
        change = np.abs(P - last).max() / np.abs(P).max()
        if change < CONVERGED:
            break
    else:
        raise RuntimeError(
            f"the Riccati recursion still changes by {change:.2g} of the cost to go after {ROUNDS} "
            f"strides; wanted is {CONVERGED:g}: no law holds this gait with effort = {effort:g}"
        )
    more = 0, 4 - n
    gains = np.pad((ends @ A)[:, 0], ((0, 0), more))
    surface = np.pad(np.roll(ends[:, 0], FINENESS, axis=0), ((0, 0), more))
    return Optimal(gains, surface, np.pad(to_go, ((0, 0), more, more)))


def weights(ahead: float) -> Floats:
    """The cost (4, 4) of a deviation in coordinates of `Transverse`; see `riccati`."""
    return np.diag([1.0, 1.0, 1.0, ahead**-2])


def multipliers(law: Law, solution: Solution) -> Floats:
    """Sizes of the multipliers of a stride across the orbit, at 100 Hz, largest first, shape (3,).

    The law is differentiated at one state of every control period, and the stride goes from one of
    these states to the next (`transverse_dynamics`). The wheel is taken to be in step with
    the gait at every decision: a deviation makes it early or late, which under a hold comes back as
    a small deviation, and that is left out. Which sign it has depends on where the touchdown falls
    between two decisions. They are infinite where they exceed all numbers.
    """
    grid = Grid.of(solution)
    require_machine("law", law, solution.params)
    A, B, into = transverse_dynamics(grid)
    out = np.linalg.inv(into)
    product = np.eye(3)
    for j in range(0, len(A), FINENESS):
        nudges = DIFFERENCE * out[j].T[:3]
        volts = law(np.concatenate([grid.states[j] + nudges, grid.states[j] - nudges]))
        slopes = (volts[:3] - volts[3:]) / (2 * DIFFERENCE)
        with np.errstate(over="ignore", invalid="ignore"):  # in a rest on one leg, in open loop
            product = (A[j, :3, :3] + B[j, :3] * slopes) @ product
    if not np.isfinite(product).all():
        return np.full(3, np.inf)
    return np.asarray(np.sort(np.abs(np.linalg.eigvals(product)))[::-1])
