"""Receding-horizon control about a gait: a short optimal control problem at every decision.

    minimise  1/2 sum_k (|y_k|^2 + r d_k^2 + |c_k|^2) + 1/2 y_N' P(s_N) y_N,
    V_k = V*(s_k) + d_k within the limit

over a horizon of N control intervals: y is the deviation from the orbit at its nearest point s and
from the gait's clock, in standard deviations of the gait's own motion, d a shift of its voltage, c
how far the foot is less pressed down or nearer to slipping than the gait allows, and P the cost to
go of the LQR (`trajopt.feedback.riccati`), which stands for all the time after. Only V_0 is
played.

There is no time to solve the problem to the end, and no need to: the LQR's own motion from the
state, with a few variants, is where a fixed number of iterations starts (Diehl, Bock and
Schloeder, A real-time iteration scheme, SIAM J. Control Optim. 2005). An iteration is control-
limited iLQR (`trajopt.feedback.ilqr`). The law has no memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rimless_gym.checks import integer, positive
from rimless_gym.energy import ROW
from rimless_gym.jit import inner
from rimless_gym.kernel.stepping import MODE, SCRATCH_SIZE, STATE_SIZE
from trajopt.feedback.clock import Clock
from trajopt.feedback.guard import CONTACT_MARGIN
from trajopt.feedback.horizon import LANES, Machine, Price, motion_from, move_on
from trajopt.feedback.ilqr import improved
from trajopt.feedback.law import Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Grid, Orbit
from trajopt.feedback.riccati import riccati, weights
from trajopt.feedback.transverse import transverse_dynamics
from trajopt.gaits.solution import Solution

#: Control intervals that are planned.
HORIZON = 30

#: Iterations of iLQR per decision.
ITERATIONS = 2

#: Price of a normal force that is less than the margin by the weight, and of a friction demand
#: that exceeds its margin by 1, in standard deviations of the gait's own motion.
LIFTING, SLIPPING = 30.0, 10.0

#: Largest margin of the normal force, in weights, and the share of the friction coefficient that
#: may be used. Where the gait itself goes beyond them, it is the margin.
PRESSED, GRIP = CONTACT_MARGIN, 0.995

#: The variants of the LQR's motion from which a decision starts: a share of the voltage limit is
#: added for so many intervals.
PUSHES = (0.0, 1.0, -1.0, 1.0, -1.0, 0.5, -0.5, 0.0)
PUSHED = (0, 2, 2, 6, 6, 12, 12, 0)


class Data(NamedTuple):
    """What the law needs.

    Attributes:
        orbit: the gait's.
        gains: the LQR's.
        price: of motions.
        machine: for the stepping kernel.
        horizon: see `HORIZON`.
        iterations: see `ITERATIONS`.
    """

    orbit: Orbit
    gains: lqr.Gains
    price: Price
    machine: Machine
    horizon: int
    iterations: int


def design(
    solution: Solution,
    horizon: int = HORIZON,
    iterations: int = ITERATIONS,
    effort: float = lqr.GENTLE,
    lifting: float = LIFTING,
    slipping: float = SLIPPING,
    ahead: float | None = lqr.AHEAD,
) -> Law:
    """The law for a gait.

    Args:
        solution: the gait.
        horizon: see `HORIZON`; >= 1.
        iterations: see `ITERATIONS`; >= 0, and 0 is the best of the starts.
        effort: cost of a squared volt, see `trajopt.feedback.laws.lqr.GENTLE`; > 0.
        lifting: see `LIFTING`; > 0.
        slipping: see `SLIPPING`; > 0.
        ahead: see `trajopt.feedback.laws.lqr.AHEAD`; > 0, or None.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: a number is out of its range, or the gait failed its verification.
        RuntimeError: the Riccati recursion does not converge.
    """
    start = lqr.design(solution, ahead=ahead)
    price = price_about(
        solution,
        start.data.orbit,
        positive("effort", effort),
        positive("lifting", lifting),
        positive("slipping", slipping),
        Clock.of(solution, ahead),
    )
    data = Data(
        orbit=start.data.orbit,
        gains=start.data,
        price=price,
        machine=Machine.of(solution.params),
        horizon=integer("horizon", horizon, least=1),
        iterations=integer("iterations", iterations, least=0),
    )
    return Law(solution.params, volts, data, smooth=False)


def price_about(
    solution: Solution,
    orbit: Orbit,
    effort: float,
    lifting: float,
    slipping: float,
    clock: Clock,
) -> Price:
    """What motions cost; the numbers are those of `design`."""
    grid, params = Grid.of(solution), solution.params
    transverse = transverse_dynamics(grid)
    into, to_go = transverse.into, riccati(transverse, effort, clock.ahead).to_go
    turned = into.swapaxes(1, 2)
    checked = solution.verification
    weight = params.weight
    return Price(
        orbit=orbit,
        stage=grid.at_nodes(turned @ weights(clock.ahead) @ into),
        final=grid.at_nodes(turned @ to_go @ into),
        tangent=grid.at_nodes(grid.tangents),
        voltage_slope=grid.at_nodes(grid.voltage_rates[:, None] * into[:, 3]),
        clock=clock,
        effort=effort,
        normal=min(PRESSED * weight, checked.min_normal_force),
        friction=max(
            GRIP * params.friction, checked.max_friction_demand, checked.max_impulse_friction_demand
        ),
        lifting=lifting / weight,
        slipping=slipping,
    )


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    motion = started(x, mode, data)
    best = np.argmin(motion.costs)
    for _ in range(data.iterations):
        motion = improved(motion, best, data.price, data.machine)
        best = np.argmin(motion.costs)
    return motion.own[0, best] + motion.shifts[0, best]


@inner
def started(x, mode, data):  # type: ignore[no-untyped-def]
    """The motions of the LQR and its variants over the horizon."""
    n, limit = data.horizon, data.orbit.limit
    state, out, work = np.zeros(STATE_SIZE), np.empty((len(ROW), LANES)), np.zeros(SCRATCH_SIZE)
    for c in range(4):
        state[c] = x[c]
    state[MODE] = mode
    motion = motion_from(state, n, data.price)
    for k in range(n):
        for lane in range(LANES):
            u = lqr.volts(motion.states[k, :4, lane], mode, data.gains)
            if k < PUSHED[lane]:
                u += PUSHES[lane] * limit
            motion.shifts[k, lane] = u - motion.own[k, lane]
        move_on(motion, k, data.price, data.machine, out, work)
    return motion
