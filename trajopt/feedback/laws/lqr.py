"""Transverse LQR about a gait, at 100 Hz.

    V = V*(s) - K(s) (x - x*(s)),    s: the point of the orbit nearest to x

The gains are those of the periodic discrete-time LQR of the deviations across the orbit under the
zero-order hold, with the saltation of the touchdowns (`trajopt.feedback.transverse`). They are
computed for every node of the orbit, several to a control period, and are linear in between: the
law has no jumps near the gait.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rimless_gym.checks import positive
from rimless_gym.jit import inner
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.orbit import Clock, Grid, Orbit, between, offset
from trajopt.feedback.transverse import riccati, transverse_dynamics
from trajopt.gaits.solution import Solution

#: Cost of a squared volt on the gait and away from it, where a squared deviation of one standard
#: deviation of the gait's own motion costs 1. Small gains on the gait save energy; high ones away
#: from it save the walk, because a foot that is about to lift leaves no time.
GENTLE, FIRM = 0.1, 1e-3

#: Distance from the gait, in standard deviations of its motion, at which both count alike.
BLEND = 0.06

#: Time (s) ahead of a held gait's clock that counts like one standard deviation. A held gait is
#: optimal only if its ticks come where they should.
AHEAD = 0.03


class LqrGains(NamedTuple):
    """What the law needs."""

    orbit: Orbit  # the gait's
    voltages: Floats  # on the gait (V), at its nodes, shape (n,)
    gentle: Floats  # gains on the gait, volts per deviation at its nodes, shape (n, 4)
    firm: Floats  # gains away from it, shape (n, 4)
    timing: Floats  # volts per second by which the gait is ahead of its clock, shape (n,)
    clock: Clock  # the gait's
    blend: float  # see `BLEND`


def design(solution: Solution, gentle: float = GENTLE, ahead: float | None = AHEAD) -> Law:
    """The law for a gait.

    Args:
        solution: the gait.
        gentle: cost of a squared volt on the gait; see `GENTLE`; > 0.
        ahead: see `AHEAD`; > 0, or None not to keep to the gait's clock. Where the gait has none
            (`trajopt.feedback.orbit`), it does not matter.

    Raises:
        TypeError, ValueError, RuntimeError: a number is not finite and positive; or see `Grid.of`
            and `riccati`.
    """
    grid = Grid.of(solution)
    clock = Clock.of(solution, ahead)
    transverse = transverse_dynamics(grid)
    on = riccati(transverse, positive("gentle", gentle), clock.ahead).gains
    off = riccati(transverse, FIRM, math.inf).gains
    orbit = grid.orbit()
    data = LqrGains(
        orbit=orbit,
        voltages=orbit.voltages,
        gentle=grid.at_nodes(transverse.per_deviation(on)),
        firm=grid.at_nodes(transverse.per_deviation(off)),
        timing=grid.at_nodes(on[:, 3]),
        clock=clock,
        blend=BLEND,
    )
    return Law(solution.params, volts, data)


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    off = offset(x, data.orbit, data.clock)
    spot, d = off.spot, off.across
    gentle, firm = between(data.gentle, spot), between(data.firm, spot)
    share = spot.squared / (spot.squared + data.blend**2)
    u = between(data.voltages, spot)
    for c in range(4):
        u -= (gentle[c] + share * (firm[c] - gentle[c])) * d[c]
    return u - (1 - share) * between(data.timing, spot) * off.early
