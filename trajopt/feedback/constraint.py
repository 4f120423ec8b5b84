"""A gait as a virtual constraint: one angle of the wheel as a function of the other.

    y = q - q_d(s),    s: the angle that serves as phase, q: the other one

y is 0 on the gait and does not depend on time (Westervelt, Grizzle and Koditschek,
Hybrid zero dynamics of planar biped walkers, IEEE TAC 2003). A phase must never stand still. The
leg does, nearly, in low-cost gaits: it waits before it lands, and may even swing back a little. The
pendulum whirls on, so its angle is the phase where the gait allows the choice.

Along the gait q_d' = q'/s' and q_d'' = (q'' - q_d' s'')/s'^2. The accelerations are those under the
mean of the gait's voltage over the coming control period. Then y'' = 0 requires that mean on the
gait, as the hold does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rimless_gym.hybrid import relative_rate
from rimless_gym.jit import inner
from rimless_gym.params import Constants
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import Grid, Orbit, Spot, between, located
from trajopt.gaits.solution import Solution

#: Least rate of the phase on the gait, as a share of its mean size.
LEAST_RATE = 0.1

#: Least sine of the angle between the gait's path (phi, theta) and the accelerations that a voltage
#: causes. At 0 no voltage moves the wheel off its path or back to it.
LEAST_SINE = 0.03

#: The angle that serves as phase, as an index.
LEG, PENDULUM = 0, 1


class VirtualConstraint(NamedTuple):
    """The constraint at the orbit's nodes."""

    orbit: Orbit  # the gait's
    phase: int  # which angle s is, `LEG` or `PENDULUM`
    direction: float  # sign of s'
    slope: Floats  # q_d' at the nodes, shape (n,)
    bend: Floats  # q_d'' (1/rad), shape (n,)
    authority: float  # sign of the y'' that a voltage causes


class ConstraintGains(NamedTuple):
    """What a law that holds a constraint needs: gains of the errors of the angle and its rate."""

    orbit: Orbit
    constraint: VirtualConstraint
    constants: Constants
    kp: float
    kd: float


class Output(NamedTuple):
    """The output y at a state, and what it takes to differentiate it again."""

    y: float  # error of the angle (rad)
    dy: float  # its rate (rad/s)
    # of the motor's rate psi', against the gait's at the same phase (rad/s)
    motor_rate_error: float
    slope: float  # q_d' there
    bend: float  # q_d'' there (1/rad)
    voltage: float  # the gait's there (V)


def constraint_of(solution: Solution) -> VirtualConstraint:
    """The virtual constraint of a gait.

    A ValueError if both angles stand still somewhere, or no voltage moves the wheel off its path.
    """
    orbit = Grid.of(solution).orbit()
    rates = orbit.states[:, 2:].T
    phase = phase_of(rates)
    other = 1 - phase
    accelerations, gains = _accelerations(solution, orbit)
    s, slope = rates[phase], rates[other] / rates[phase]
    bend = (accelerations[other] - slope * accelerations[phase]) / s**2
    across = gains[other] - slope * gains[phase]
    sines = across / (np.hypot(1.0, slope) * np.hypot(*gains))
    authority = np.sign(sines.sum())
    if (authority * sines).min() < LEAST_SINE:
        raise ValueError(
            f"solution: the sine between its path and what a voltage accelerates falls to "
            f"{(authority * sines).min():.3g}; must be at least {LEAST_SINE:g} everywhere, or no "
            "voltage holds the constraint; take another law, such as 'lqr'"
        )
    return VirtualConstraint(orbit, phase, float(np.sign(s[0])), slope, bend, float(authority))


def phase_of(rates: Floats) -> int:
    """Which of two angles turns steadily, given their rates (2, n); a ValueError if none does."""
    steadiness = np.abs(rates.mean(axis=1)) / np.abs(rates).mean(axis=1)
    least = np.abs(rates).min(axis=1) / np.abs(rates).mean(axis=1)
    least[steadiness < 1.0 - 1e-12] = 0.0  # it turns round
    phase = int(least.argmax())
    if least[phase] < LEAST_RATE:
        raise ValueError(
            f"solution: the slowest rate of the leg is {least[0]:.3g} of its mean, that of the "
            f"pendulum {least[1]:.3g} (0 where it turns round); one must be at least "
            f"{LEAST_RATE:g} to serve as phase; take another law, such as 'lqr'"
        )
    return phase


def _accelerations(solution: Solution, orbit: Orbit) -> tuple[Floats, Floats]:
    """Accelerations at the orbit's nodes, and what a volt adds to them, shape (2, n) both."""
    flow = HybridModel(solution.params).functions["flow"].map(len(orbit.states))
    at, above = (np.asarray(flow(orbit.states.T, orbit.voltages[None] + v))[2:] for v in (0.0, 1.0))
    return at, above - at


@inner
def output(x, c, p):  # type: ignore[no-untyped-def]
    """The `Output` at a state, on the step on which the nearest point of the orbit lies.

    A touchdown that comes late finds the constraint drawn out beyond the end of its step.
    """
    states, s, q = c.orbit.states, c.phase, 1 - c.phase
    i = located(x, c.orbit).node
    if not c.orbit.continued[i]:
        i -= 1
    past, width = _past(x, states, i, c), _past(states[i + 1], states[i:], 0, c)
    for _ in range(len(states)):
        if past < 0.0 and i > 0 and c.orbit.continued[i - 1]:
            i -= 1
        elif past > width and c.orbit.continued[i + 1]:
            i += 1
        else:
            break
        past, width = _past(x, states, i, c), _past(states[i + 1], states[i:], 0, c)
    share = min(max(past / width, 0.0), 1.0)
    spot, rest = Spot(i, share, 0.0), c.direction * (past - share * width)
    on, bend = between(states, spot), between(c.bend, spot)
    slope = between(c.slope, spot)
    turn = x[q] - on[q] - rest * (slope + 0.5 * bend * rest)
    y = turn - 2 * np.pi * np.round(turn / (2 * np.pi))
    slope += bend * rest
    motor_rate_error = relative_rate(x[2], x[3], p) - relative_rate(on[2], on[3], p)
    volts = between(c.orbit.voltages, spot)
    return Output(y, x[2 + q] - slope * x[2 + s], motor_rate_error, slope, bend, volts)


@inner
def _past(x, states, i, c):  # type: ignore[no-untyped-def]
    """How far the phase of x is past that of node i (rad), by the shorter way round."""
    turn = x[c.phase] - states[i, c.phase]
    return c.direction * (turn - 2 * np.pi * np.round(turn / (2 * np.pi)))
