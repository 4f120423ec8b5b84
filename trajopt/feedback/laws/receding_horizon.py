"""Receding-horizon control about a gait: a short optimal control problem at every decision.

    minimise  1/2 sum_k (|y_k|^2 + r d_k^2 + |c_k|^2) + 1/2 y_N' P(s_N) y_N,
    V_k = V*(s_k) + d_k within the limit

y is the deviation from the orbit at its nearest point s and from the gait's clock, d a shift of its
voltage, c how far the foot is less pressed down or nearer to slipping than the gait allows, and P
the LQR's cost to go. Only V_0 is applied; docs/feedback.md has the reasons.

A decision starts from the LQR's own motion and a few variants, for a fixed number of iterations
(Diehl, Bock and Schloeder, A real-time iteration scheme, SIAM J. Control Optim. 2005). An iteration
of control-limited iLQR makes a quadratic model backwards, with the Gauss-Newton Hessian of all
costs; its minimum is a change of every shift, with gains for the states that follow. Forward,
shares of the change are simulated on the stepping kernel, all at once, and the best is kept (Tassa,
Mansard and Todorov, Control-limited differential dynamic programming, ICRA 2014). The derivative
dy/dx is taken as the identity. That is right up to the orbit's curvature: along the orbit, y
changes by the time ahead, or is not weighed at all. The foot is held like a pin joint, so that an
interval in which the ground would have to pull has a penalty, and no end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import inner
from rimless_gym.kernel.stepping import (
    FOOT,
    MODE,
    SCRATCH_SIZE,
    STATE_SIZE,
    advance_batch_at,
    kernel_address,
    machine_arrays,
)
from trajopt.feedback.controller import CONTACT_MARGIN
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Grid, Orbit, between, deviation, located, offset
from trajopt.feedback.transverse import riccati, transverse_dynamics, weights
from trajopt.gaits.solution import Solution

#: Control intervals that are planned.
HORIZON = 30

#: Iterations of iLQR per decision.
ITERATIONS = 2

#: Penalty of a normal force that is less than the margin by the weight, and of a friction demand
#: that exceeds its margin by 1, in standard deviations of the gait's own motion.
LIFTING, SLIPPING = 30.0, 10.0

#: Largest margin of the normal force, in weights, and the share of the friction coefficient that
#: may be used. Where the gait itself goes beyond them, it is the margin.
PRESSED, GRIP = CONTACT_MARGIN, 0.995

#: The variants of the LQR's motion from which a decision starts: a share of the voltage limit is
#: added for so many intervals.
PUSHES = (0.0, 1.0, -1.0, 1.0, -1.0, 0.5, -0.5, 0.0)
PUSHED = (0, 2, 2, 6, 6, 12, 12, 0)

#: Motions that the kernel simulates at a time: as many take hardly longer than one.
LANES = 8

#: Residuals of an interval: how far the normal force falls below its margin, and the friction
#: demand exceeds its own.
RESIDUALS = 2

#: Of the central differences (rad, rad/s, V).
DIFFERENCE = 1e-5

#: Largest friction demand: an unloaded foot has an infinite one.
MOST_DEMAND = 10.0


class Lookahead(NamedTuple):
    """What the law needs.

    What a motion near a gait costs is in squared standard deviations of the gait's motion.
    """

    orbit: Orbit  # the gait's
    gains: lqr.LqrGains  # the LQR's
    stage: Floats  # weights of a deviation in every interval, at the orbit's nodes, shape (n, 4, 4)
    final: Floats  # the same for all the time after the horizon, shape (n, 4, 4)
    tangent: Floats  # rates of the state along the orbit, shape (n, 4)
    # derivatives of the gait's voltage at the nearest point by the state, shape (n, 4)
    voltage_slope: Floats
    normal: float  # least normal force (N) without a penalty
    friction: float  # largest friction demand without a penalty
    lifting: float  # residual per newton
    kernel: int  # address of the stepping kernel, which only this process knows
    constants: Floats  # of the stepping kernel, shape (N_CONSTANTS, 1)
    poles: Floats  # of the stepping kernel, shape (1,)
    horizon: int  # control intervals

    def __reduce__(self) -> Any:
        """Refuse to leave this process."""
        raise TypeError("a receding-horizon law stays in its process: design it where it acts")


def design(solution: Solution) -> Law:
    """The law for a gait; it raises what `lqr.design` does."""
    gains = lqr.design(solution).data
    grid, params, gait = Grid.of(solution), solution.params, solution.verification
    transverse = transverse_dynamics(grid)
    into, ahead = transverse.into, gains.clock.ahead
    to_go = riccati(transverse, lqr.GENTLE, ahead).to_go
    turned = into.swapaxes(1, 2)
    constants, poles = machine_arrays([params])
    data = Lookahead(
        orbit=gains.orbit,
        gains=gains,
        stage=grid.at_nodes(turned @ weights(ahead) @ into),
        final=grid.at_nodes(turned @ to_go @ into),
        tangent=grid.at_nodes(grid.tangents),
        voltage_slope=grid.at_nodes(grid.voltage_rates[:, None] * into[:, 3]),
        normal=min(PRESSED * params.weight, gait.min_normal_force),
        friction=max(
            GRIP * params.friction, gait.max_friction_demand, gait.max_impulse_friction_demand
        ),
        lifting=LIFTING / params.weight,
        kernel=kernel_address(),
        constants=constants,
        poles=poles,
        horizon=HORIZON,
    )
    return Law(params, volts, data, smooth=False)


class Motion(NamedTuple):
    """Motions over a horizon of N intervals, `LANES` side by side."""

    states: Any  # shape (N + 1, STATE_SIZE, LANES)
    nominal: Any  # the gait's voltages at the nearest points (V), shape (N + 1, LANES)
    shifts: Any  # what is added to them (V), shape (N, LANES)
    residuals: Any  # of the intervals, shape (N, RESIDUALS, LANES)
    costs: Any  # shape (LANES,); infinite where the simulator stops


class Slopes(NamedTuple):
    """Derivatives by the state and the shift (the last column) along a motion."""

    states: Any  # of the next state, shape (N, 4, 5)
    residuals: Any  # shape (N, RESIDUALS, 5)


class Change(NamedTuple):
    """A change of the shifts over N intervals."""

    changes: Any  # (V), shape (N,)
    gains: Any  # volts per deviation from the motion so far, shape (N, 4)


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    motion = started(x, mode, data)
    best = np.argmin(motion.costs)
    for _ in range(ITERATIONS):
        motion = improved(motion, best, data)
        best = np.argmin(motion.costs)
    return motion.nominal[0, best] + motion.shifts[0, best]


@inner
def started(x, mode, data):  # type: ignore[no-untyped-def]
    """The motions of the LQR and its variants over the horizon."""
    state, out, work = np.zeros(STATE_SIZE), np.empty((len(ROW), LANES)), np.zeros(SCRATCH_SIZE)
    state[:4] = x
    state[MODE] = mode
    motion = motion_from(state, data)
    for k in range(data.horizon):
        for lane in range(LANES):
            u = lqr.volts(motion.states[k, :4, lane], mode, data.gains)
            if k < PUSHED[lane]:
                u += PUSHES[lane] * data.orbit.limit
            motion.shifts[k, lane] = u - motion.nominal[k, lane]
        move_on(motion, k, data, out, work)
    return motion


@inner
def improved(motion, lane, data):  # type: ignore[no-untyped-def]
    """The motions after an iteration from one lane of others; the last one is that lane itself."""
    states, nominal = motion.states[:, :, lane].copy(), motion.nominal[:, lane].copy()
    shifts = motion.shifts[:, lane].copy()
    slopes = slopes_of(states, nominal, shifts, data)
    step = backward(states, shifts, motion.residuals[:, :, lane], slopes, data)
    return forward(states, shifts, step, data)


@inner
def backward(states, shifts, residuals, slopes, data):  # type: ignore[no-untyped-def]
    """The best `Change` of the quadratic model."""
    n = len(shifts)
    step = Change(np.zeros(n), np.zeros((n, 4)))
    spot, y = deviation_at(states[n, :4], data)
    Vxx = between(data.final, spot).copy()
    Vx = slope_of(Vxx, y)
    for k in range(n - 1, -1, -1):
        spot, y = deviation_at(states[k, :4], data)
        Qx, Qxx = quadratic(Vx, Vxx, residuals[k], slopes.states[k], slopes.residuals[k])
        Qx[4] += lqr.GENTLE * shifts[k]
        Qxx[4, 4] += lqr.GENTLE
        stage = between(data.stage, spot)
        slope = slope_of(stage, y)
        for i in range(4):
            Qx[i] += slope[i]
            for j in range(4):
                Qxx[i, j] += stage[i, j]
        applied = between(data.orbit.voltages, spot) + shifts[k]
        free = -Qx[4] / Qxx[4, 4]
        change = min(max(free, -data.orbit.limit - applied), data.orbit.limit - applied)
        step.changes[k] = change
        gains = step.gains[k]
        for i in range(4):
            gains[i] = -Qxx[4, i] / Qxx[4, 4] if change == free else 0.0
        for i in range(4):
            Vx[i] = Qx[i] + Qxx[i, 4] * change + gains[i] * (Qx[4] + Qxx[4, 4] * change)
            for j in range(4):
                Vxx[i, j] = Qxx[i, j] + Qxx[4, 4] * gains[i] * gains[j]
                Vxx[i, j] += gains[i] * Qxx[4, j] + Qxx[i, 4] * gains[j]
    return step


@inner
def quadratic(Vx, Vxx, residuals, slopes, residual_slopes):  # type: ignore[no-untyped-def]
    """Gradient (5,) and Hessian (5, 5) by state and shift of the cost to go, and of residuals."""
    gradient, hessian, product = np.zeros(5), np.zeros((5, 5)), np.zeros((4, 5))
    for i in range(4):
        for j in range(5):
            gradient[j] += slopes[i, j] * Vx[i]
            for c in range(4):
                product[i, j] += Vxx[i, c] * slopes[c, j]
    for i in range(5):
        for j in range(5):
            for c in range(4):
                hessian[i, j] += slopes[c, i] * product[c, j]
    for which in range(RESIDUALS):
        slope = residual_slopes[which]
        for i in range(5):
            gradient[i] += slope[i] * residuals[which]
            for j in range(5):
                hessian[i, j] += slope[i] * slope[j]
    return gradient, hessian


@inner
def forward(states, shifts, step, data):  # type: ignore[no-untyped-def]
    """Simulate a step's shares 1, 1/2, 1/4, ... and 0, each in a lane."""
    out, work = np.empty((len(ROW), LANES)), np.zeros(SCRATCH_SIZE)
    motion = motion_from(states[0], data)
    for k in range(data.horizon):
        for lane in range(LANES):
            x = motion.states[k, :, lane]
            shift = shifts[k] + (0.5**lane * step.changes[k] if lane + 1 < LANES else 0.0)
            if x[FOOT] == states[k, FOOT] and x[MODE] == states[k, MODE]:
                d = deviation(x, states[k])
                for c in range(4):
                    shift += step.gains[k, c] * d[c]
            motion.shifts[k, lane] = shift
        move_on(motion, k, data, out, work)
    return motion


@inner
def motion_from(state, data):  # type: ignore[no-untyped-def]
    """A `Motion` over the horizon that stands at a hybrid state."""
    n = data.horizon
    motion = Motion(
        np.zeros((n + 1, STATE_SIZE, LANES)),
        np.zeros((n + 1, LANES)),
        np.zeros((n, LANES)),
        np.zeros((n, RESIDUALS, LANES)),
        np.zeros(LANES),
    )
    for lane in range(LANES):
        motion.states[0, :, lane] = state
    motion.nominal[0] = between(data.orbit.voltages, located(state, data.orbit))
    return motion


@inner
def deviation_at(x, data):  # type: ignore[no-untyped-def]
    """The spot of a state, and the deviation (4,) that costs: it includes being ahead."""
    off = offset(x, data.orbit, data.gains.clock)
    d, tangent = off.across, between(data.tangent, off.spot)
    return off.spot, np.array(
        (
            d[0] + off.early * tangent[0],
            d[1] + off.early * tangent[1],
            d[2] + off.early * tangent[2],
            d[3] + off.early * tangent[3],
        )
    )


@inner
def slope_of(weights, y):  # type: ignore[no-untyped-def]
    """The gradient (4,) of half of y's square in weights (4, 4)."""
    gradient = np.zeros(4)
    for i in range(4):
        for j in range(4):
            gradient[i] += weights[i, j] * y[j]
    return gradient


@inner
def halved_square(weights, y):  # type: ignore[no-untyped-def]
    """Half of y's square in weights (4, 4)."""
    gradient = slope_of(weights, y)
    return 0.5 * (gradient[0] * y[0] + gradient[1] * y[1] + gradient[2] * y[2] + gradient[3] * y[3])


@inner
def limited(voltage, data):  # type: ignore[no-untyped-def]
    """A voltage within the limit."""
    return min(max(voltage, -data.orbit.limit), data.orbit.limit)


@inner
def residual(out, i, which, data):  # type: ignore[no-untyped-def]
    """How far wheel i's interval is beyond a margin, weighed."""
    if which == 0:
        return data.lifting * max(data.normal - out[ROW.min_normal_force, i], 0.0)
    demand = max(out[ROW.friction_demand, i], out[ROW.impulse_friction_demand, i])
    return SLIPPING * max(min(demand, MOST_DEMAND) - data.friction, 0.0)


@inner
def move_on(motion, k, data, out, work):  # type: ignore[no-untyped-def]
    """Simulate interval k of all lanes, and add its cost; shifts end at the voltage limit."""
    volts, last = np.empty(LANES), k + 1 == len(motion.shifts)
    following = motion.states[k + 1]
    following[:] = motion.states[k]
    for lane in range(LANES):
        volts[lane] = limited(motion.nominal[k, lane] + motion.shifts[k, lane], data)
        motion.shifts[k, lane] = volts[lane] - motion.nominal[k, lane]
    advanced(following, volts, data, out, work)
    for lane in range(LANES):
        cost = 0.5 * lqr.GENTLE * motion.shifts[k, lane] ** 2
        for which in range(RESIDUALS):
            exceeded = residual(out, lane, which, data)
            motion.residuals[k, which, lane] = exceeded
            cost += 0.5 * exceeded**2
        spot, y = deviation_at(following[:4, lane], data)
        motion.nominal[k + 1, lane] = between(data.orbit.voltages, spot)
        cost += halved_square(between(data.final if last else data.stage, spot), y)
        motion.costs[lane] += cost if out[ROW.failure, lane] == 0.0 else np.inf


@inner
def advanced(states, volts, data, out, work):  # type: ignore[no-untyped-def]
    """Advance states (STATE_SIZE, n) by a control interval, the foot held like a pin."""
    advance_batch_at(
        data.kernel,
        (
            *(data.constants, data.poles, states, volts, np.int64(0), states.shape[1]),
            *(CONTROL_PERIOD, np.inf, out, work),
        ),
    )


@inner
def slopes_of(states, nominal, shifts, data):  # type: ignore[no-untyped-def]
    """Central differences along a motion: states (N + 1, STATE_SIZE), voltages and shifts."""
    n, each = len(shifts), 10
    columns, volts = np.empty((STATE_SIZE, each * n)), np.empty(each * n)
    for k in range(n):
        slope = between(data.voltage_slope, located(states[k], data.orbit))
        for j in range(each):
            i, step = each * k + j, DIFFERENCE if j % 2 else -DIFFERENCE
            columns[:, i] = states[k]
            volts[i] = limited(nominal[k] + shifts[k], data)
            if j < 8:
                columns[j // 2, i] += step
                volts[i] += step * slope[j // 2]
            else:
                volts[i] += step
    out, work = np.empty((len(ROW), each * n)), np.zeros(SCRATCH_SIZE)
    advanced(columns, volts, data, out, work)
    slopes = Slopes(np.empty((n, 4, 5)), np.empty((n, RESIDUALS, 5)))
    for k in range(n):
        for j in range(5):
            less, more = each * k + 2 * j, each * k + 2 * j + 1
            for c in range(4):
                change = columns[c, more] - columns[c, less]
                slopes.states[k, c, j] = change / (2 * DIFFERENCE)
            for which in range(RESIDUALS):
                rise = residual(out, more, which, data) - residual(out, less, which, data)
                slopes.residuals[k, which, j] = rise / (2 * DIFFERENCE)
    return slopes
