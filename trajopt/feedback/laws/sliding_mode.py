"""Discrete-time sliding mode on the deviation across a gait's orbit, at 100 Hz.

    sigma = c(s) e,    V = V*(s) + sigma - c(s + T) A(s) e - gain sat(sigma / layer)

e is the deviation across the orbit at its nearest point s, and e(s + T) = A e + B v what becomes of
it in a control period T under V* + v (`trajopt.feedback.transverse`). With b = c(s + T) B(s),

    sigma(s + T) = b (sigma - gain sat(sigma / layer)) + (1 - b) c(s + T) A e

(Gao, Wang and Homaifa, Discrete-time variable structure control systems, IEEE TIE 1995). The
voltage of the switching term never exceeds `switching_gain`, nor that of a small sigma its share.

c(s + T) = B' P / (r + B' P B), with P from the Riccati recursion of the LQR and r its cost of a
squared volt: on the surface c e = 0 the motion is as under optimal control (Utkin and Young,
Methods for constructing discontinuity planes, Automation and Remote Control 1978). With b = 1 the
law would ask for everything where a volt does next to nothing, as just before a touchdown, and lose
the foot.

With a held gait, e has a fourth coordinate: the time by which the wheel is ahead of the nearest
tick of the gait's clock. docs/feedback.md has the rest.
"""

from __future__ import annotations

from typing import NamedTuple

from rimless_gym.jit import inner
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.orbit import Clock, Grid, Orbit, between, offset
from trajopt.feedback.transverse import riccati, transverse_dynamics
from trajopt.gaits.solution import Solution

#: Volts by which sigma shrinks in a period, and half the width of the boundary layer, both as
#: shares of the voltage limit. The former is the smaller one, or sigma would overshoot.
SWITCHING_GAIN, LAYER = 0.5, 0.7

#: Cost of a squared volt in the Riccati recursion behind the surface, where a squared deviation of
#: one standard deviation of the gait's own motion costs 1.
EFFORT = 0.03

#: Time (s) ahead of a held gait's clock that counts like one standard deviation.
AHEAD = 0.05


class Surface(NamedTuple):
    """What the law needs."""

    orbit: Orbit  # the gait's
    now: Floats  # sigma per deviation at its nodes (V), shape (n, 4)
    later: Floats  # sigma a period later under V*, per deviation now, shape (n, 4)
    timing_now: Floats  # sigma per second by which the gait is ahead of its clock, shape (n,)
    timing_later: Floats  # the same a period later, shape (n,)
    switching_gain: float  # V
    layer: float  # V
    clock: Clock  # the gait's


def design(solution: Solution) -> Law:
    """The law for a gait; it raises what `Grid.of` and `riccati` do."""
    grid, limit = Grid.of(solution), solution.params.voltage_limit
    clock = Clock.of(solution, AHEAD)
    transverse = transverse_dynamics(grid)
    optimal = riccati(transverse, EFFORT, clock.ahead)
    data = Surface(
        orbit=grid.orbit(),
        now=grid.at_nodes(transverse.per_deviation(optimal.surface)),
        later=grid.at_nodes(transverse.per_deviation(optimal.gains)),
        timing_now=grid.at_nodes(optimal.surface[:, 3]),
        timing_later=grid.at_nodes(optimal.gains[:, 3]),
        switching_gain=SWITCHING_GAIN * limit,
        layer=LAYER * limit,
        clock=clock,
    )
    return Law(solution.params, volts, data)


@inner
def sigma_now_and_later(x, data):  # type: ignore[no-untyped-def]
    """The gait's voltage at the nearest point, sigma, and sigma a period later under it."""
    off = offset(x, data.orbit, data.clock)
    spot = off.spot
    now, later = between(data.now, spot), between(data.later, spot)
    sigma = between(data.timing_now, spot) * off.early
    free = between(data.timing_later, spot) * off.early
    for c in range(4):
        sigma += now[c] * off.across[c]
        free += later[c] * off.across[c]
    return between(data.orbit.voltages, spot), sigma, free


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    u, sigma, free = sigma_now_and_later(x, data)
    return u + sigma - free - data.switching_gain * min(max(sigma / data.layer, -1.0), 1.0)
