"""Transverse LQR about a gait, at 100 Hz.

    V = V*(s) - K(s) (x - x*(s)),    s: the point of the orbit nearest to x

The gains are those of the periodic discrete-time LQR of the deviations across the orbit under the
zero-order hold, with the saltation of the touchdowns (Bittanti, Colaneri and De Nicolao, The
Riccati Equation, 1991, for the periodic recursion). They are computed for every node of the orbit,
several to a control period, and are linear in between: the law has no jumps near the gait.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rimless_gym.checks import positive
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import inner
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.orbit import FINENESS, Grid, Orbit, between, deviation, located
from trajopt.feedback.transverse import transverse_dynamics
from trajopt.gaits.solution import Solution

#: Cost of a squared volt on the gait and away from it, where a squared deviation of one standard
#: deviation of the gait's own motion costs 1. Small gains on the gait save energy; high ones away
#: from it save the walk, because a foot that is about to lift leaves no time.
GENTLE, FIRM = 0.1, 1e-3

#: Distance from the gait, in standard deviations of its motion, at which both count alike.
BETWEEN = 0.06

#: Time (s) ahead of a held gait's clock that counts like one standard deviation. A held gait is
#: optimal only if its ticks come where they should.
AHEAD = 0.03

#: Most rounds of the Riccati recursion, and the change (relative) at which it has converged.
ROUNDS, CONVERGED = 200, 1e-9


class Gains(NamedTuple):
    """What the law needs.

    Attributes:
        orbit: the gait's.
        gentle: gains on the gait, volts per deviation at its nodes, shape (n, 4).
        firm: gains away from it, shape (n, 4).
        clock: volts per second by which the gait is ahead of the clock, shape (n,).
        hold: period of the clock (s).
        tick: time of one of its ticks (s).
        between: see `BETWEEN`.
    """

    orbit: Orbit
    gentle: Floats
    firm: Floats
    clock: Floats
    hold: float
    tick: float
    between: float


def design(
    solution: Solution,
    gentle: float = GENTLE,
    firm: float = FIRM,
    between: float = BETWEEN,
    ahead: float = AHEAD,
) -> Law:
    """The law for a gait.

    Args:
        solution: the gait.
        gentle: cost of a squared volt on the gait; see `GENTLE`; > 0.
        firm: the same away from the gait; > 0.
        between: see `BETWEEN`; > 0.
        ahead: see `AHEAD`; > 0.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: a number is not finite and positive.
    """
    grid = Grid.of(solution)
    clocked = positive("ahead", ahead) if solution.hold is not None else math.inf
    on = periodic_gains(grid, positive("gentle", gentle), clocked)
    off = periodic_gains(grid, positive("firm", firm), math.inf)
    into = transverse_dynamics(grid).into[:, :3]
    gentle_gains, firm_gains = (
        grid.at_nodes(np.einsum("jk,jkc->jc", gains[:, :3], into)) for gains in (on, off)
    )
    data = Gains(
        orbit=grid.orbit(),
        gentle=gentle_gains,
        firm=firm_gains,
        clock=grid.at_nodes(on[:, 3]),
        hold=solution.hold or CONTROL_PERIOD,
        tick=solution.first_tick if solution.hold is not None else 0.0,
        between=positive("between", between),
    )
    return Law(solution.params, volts, data)


def periodic_gains(grid: Grid, effort: float, ahead: float) -> Floats:
    """Gains (m, 4) at the times of a grid, in the coordinates of `Transverse`: see `riccati`."""
    return riccati(grid, effort, ahead)[0]


def riccati(grid: Grid, effort: float, ahead: float) -> tuple[Floats, Floats]:
    """Gains (m, 4) and costs to go (m, 4, 4) at the times of a grid.

    Both are in the coordinates of `Transverse`. A period leads from a time to the `FINENESS`th
    after it, so that there are as many interleaved Riccati recursions.

    Args:
        grid: of the gait.
        effort: cost of a squared volt.
        ahead: time (s) that counts like one standard deviation; infinite: time does not count.
    """
    A, B, _ = transverse_dynamics(grid)
    cost = np.diag([1.0, 1.0, 1.0, ahead**-2])
    if math.isinf(ahead):
        A, B, cost = A[:, :3, :3], B[:, :3], cost[:3, :3]
    m, n = A.shape[:2]
    gains, P = np.zeros((m, 1, n)), np.tile(cost, (FINENESS, 1, 1))
    to_go = np.empty((m, n, n))
    for _ in range(ROUNDS):
        last = P
        for begin in range(m - FINENESS, -1, -FINENESS):
            each = slice(begin, begin + FINENESS)
            A_, B_ = A[each], B[each]
            BP = B_.swapaxes(1, 2) @ P
            gains[each] = np.linalg.solve(effort + BP @ B_, BP @ A_)
            P = cost + A_.swapaxes(1, 2) @ P @ (A_ - B_ @ gains[each])
            P = 0.5 * (P + P.swapaxes(1, 2))
            to_go[each] = P
        if np.allclose(P, last, rtol=CONVERGED, atol=0.0):
            break
    more = 0, 4 - n
    return np.pad(gains[:, 0], ((0, 0), more)), np.pad(to_go, ((0, 0), more, more))


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    spot = located(x, data.orbit)
    d = deviation(x, between(data.orbit.states, spot))
    gentle, firm = between(data.gentle, spot), between(data.firm, spot)
    share = spot.distance / (spot.distance + data.between**2)
    u = between(data.orbit.voltages, spot)
    for c in range(4):
        u -= (gentle[c] + share * (firm[c] - gentle[c])) * d[c]
    # Ahead of the nearest tick, and without a jump half way between two.
    angle = 2 * np.pi / data.hold * (between(data.orbit.times, spot) - data.tick)
    return u - (1 - share) * between(data.clock, spot) * np.sin(angle) * data.hold / (2 * np.pi)
