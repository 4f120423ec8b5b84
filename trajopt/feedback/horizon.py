"""What a stretch of a gait's future costs: motions on the stepping kernel, and their derivatives.

The kernel is the symbolic model's equations, compiled, with touchdowns located exactly: a control
interval that contains one is played and differentiated like any other. The foot is held like a pin
joint, so that an interval in which the ground would have to pull has a price, and no end.

Controls are shifts of the gait's own voltage at the nearest point of its orbit.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numba import cfunc, types

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import inner
from rimless_gym.kernel.stepping import SCRATCH_SIZE, STATE_SIZE, advance_batch, machine_arrays
from rimless_gym.params import WheelParams
from trajopt.feedback.clock import Clock, offset
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import Orbit, between, located

#: Motions that the kernel plays at a time: as many take hardly longer than one.
LANES = 8

#: Residuals of an interval: how far the normal force falls below its margin, and the friction
#: demand exceeds its own.
RESIDUALS = 2

#: Of the central differences (rad, rad/s, V).
DIFFERENCE = 1e-5

#: Largest friction demand: an unloaded foot has an infinite one.
MOST_DEMAND = 10.0


class Price(NamedTuple):
    """What a motion near a gait costs, in squared standard deviations of the gait's motion.

    Attributes:
        orbit: the gait's.
        stage: weights of a deviation in every interval, at the orbit's nodes, shape (n, 4, 4).
        final: the same for all the time after the horizon, shape (n, 4, 4).
        tangent: rates of the state along the orbit, shape (n, 4).
        voltage_slope: derivatives of the gait's voltage at the nearest point by the state, shape
            (n, 4).
        clock: the gait's.
        effort: of a squared volt.
        normal: least normal force (N) without a price.
        friction: largest friction demand without a price.
        lifting: residual per newton.
        slipping: residual per unit of friction demand.
    """

    orbit: Orbit
    stage: Floats
    final: Floats
    tangent: Floats
    voltage_slope: Floats
    clock: Clock
    effort: float
    normal: float
    friction: float
    lifting: float
    slipping: float


class Machine(NamedTuple):
    """The stepping kernel, and what it needs of a machine.

    Attributes:
        play: (states (STATE_SIZE, n), volts (n,), machine.constants, machine.poles, out, work)
            advances hybrid states by a control interval, the foot held like a pin.
        constants: shape (N_CONSTANTS, 1).
        poles: shape (1,).
    """

    play: Any
    constants: Floats
    poles: Floats

    @classmethod
    def of(cls, params: WheelParams) -> Machine:
        """The machine that `params` describes. The first call takes some seconds of compiling."""
        return cls(_play(), *machine_arrays([params]))


@functools.cache
def _play() -> Any:
    """Called by its address: every function that contained the kernel would compile it again."""
    row, table = types.float64[::1], types.float64[:, ::1]

    @cfunc(types.void(table, row, table, row, table, row))
    def play(states, volts, constants, poles, out, work):  # type: ignore[no-untyped-def]
        advance_batch(
            *(constants, poles, states, volts, 0, states.shape[1]),
            *(CONTROL_PERIOD, np.inf, out, work),
        )

    return play


class Motion(NamedTuple):
    """Motions over a horizon of N intervals, `LANES` side by side.

    Attributes:
        states: shape (N + 1, STATE_SIZE, LANES).
        own: the gait's voltages at the nearest points (V), shape (N + 1, LANES).
        shifts: what is added to them (V), shape (N, LANES).
        residuals: of the intervals, shape (N, RESIDUALS, LANES).
        costs: shape (LANES,); infinite where the simulator stops.
    """

    states: Any
    own: Any
    shifts: Any
    residuals: Any
    costs: Any


class Slopes(NamedTuple):
    """Derivatives by the state and the shift (the last column) along a motion.

    Attributes:
        states: of the next state, shape (N, 4, 5).
        residuals: shape (N, RESIDUALS, 5).
    """

    states: Any
    residuals: Any


@inner
def motion_from(state, n, price):  # type: ignore[no-untyped-def]
    """A `Motion` over n intervals that stands at a hybrid state."""
    motion = Motion(
        np.zeros((n + 1, STATE_SIZE, LANES)),
        np.zeros((n + 1, LANES)),
        np.zeros((n, LANES)),
        np.zeros((n, RESIDUALS, LANES)),
        np.zeros(LANES),
    )
    own = between(price.orbit.voltages, located(state, price.orbit))
    for lane in range(LANES):
        for c in range(STATE_SIZE):
            motion.states[0, c, lane] = state[c]
        motion.own[0, lane] = own
    return motion


@inner
def priced(x, price):  # type: ignore[no-untyped-def]
    """The spot of a state, and the deviation (4,) that costs: it includes being ahead."""
    off = offset(x, price.orbit, price.clock)
    d, early = off.across, off.early
    tangent = between(price.tangent, off.spot)
    return off.spot, np.array(
        (
            d[0] + early * tangent[0],
            d[1] + early * tangent[1],
            d[2] + early * tangent[2],
            d[3] + early * tangent[3],
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
def limited(voltage, price):  # type: ignore[no-untyped-def]
    """A voltage within the limit."""
    return min(max(voltage, -price.orbit.limit), price.orbit.limit)


@inner
def residual(out, i, which, price):  # type: ignore[no-untyped-def]
    """How far wheel i's interval is beyond a margin, weighed."""
    if which == 0:
        return price.lifting * max(price.normal - out[ROW.min_normal_force, i], 0.0)
    demand = max(out[ROW.friction_demand, i], out[ROW.impulse_friction_demand, i])
    return price.slipping * max(min(demand, MOST_DEMAND) - price.friction, 0.0)


@inner
def move_on(motion, k, price, machine, out, work):  # type: ignore[no-untyped-def]
    """Play interval k of all lanes, and add up its cost; shifts end at the voltage limit."""
    volts, last = np.empty(LANES), k + 1 == len(motion.shifts)
    following = motion.states[k + 1]
    for lane in range(LANES):
        for c in range(STATE_SIZE):
            following[c, lane] = motion.states[k, c, lane]
        volts[lane] = limited(motion.own[k, lane] + motion.shifts[k, lane], price)
        motion.shifts[k, lane] = volts[lane] - motion.own[k, lane]
    machine.play(following, volts, machine.constants, machine.poles, out, work)
    for lane in range(LANES):
        cost = 0.5 * price.effort * motion.shifts[k, lane] ** 2
        for which in range(RESIDUALS):
            exceeded = residual(out, lane, which, price)
            motion.residuals[k, which, lane] = exceeded
            cost += 0.5 * exceeded**2
        spot, y = priced(following[:4, lane], price)
        motion.own[k + 1, lane] = between(price.orbit.voltages, spot)
        cost += halved_square(between(price.final if last else price.stage, spot), y)
        motion.costs[lane] += cost if out[ROW.failure, lane] == 0.0 else np.inf


@inner
def slopes_of(states, own, shifts, price, machine):  # type: ignore[no-untyped-def]
    """Central differences along a motion: states (N + 1, STATE_SIZE), voltages and shifts."""
    n, each = len(shifts), 10
    columns, volts = np.empty((STATE_SIZE, each * n)), np.empty(each * n)
    for k in range(n):
        slope = between(price.voltage_slope, located(states[k], price.orbit))
        for j in range(each):
            i, step = each * k + j, DIFFERENCE if j % 2 else -DIFFERENCE
            for c in range(STATE_SIZE):
                columns[c, i] = states[k, c]
            volts[i] = limited(own[k] + shifts[k], price)
            if j < 8:
                columns[j // 2, i] += step
                volts[i] += step * slope[j // 2]
            else:
                volts[i] += step
    out, work = np.empty((len(ROW), each * n)), np.zeros(SCRATCH_SIZE)
    machine.play(columns, volts, machine.constants, machine.poles, out, work)
    slopes = Slopes(np.empty((n, 4, 5)), np.empty((n, RESIDUALS, 5)))
    for k in range(n):
        for j in range(5):
            less, more = each * k + 2 * j, each * k + 2 * j + 1
            for c in range(4):
                change = columns[c, more] - columns[c, less]
                slopes.states[k, c, j] = change / (2 * DIFFERENCE)
            for which in range(RESIDUALS):
                change = residual(out, more, which, price) - residual(out, less, which, price)
                slopes.residuals[k, which, j] = change / (2 * DIFFERENCE)
    return slopes
