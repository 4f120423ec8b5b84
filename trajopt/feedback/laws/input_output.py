"""Input-output linearisation of a gait's virtual constraint, at 100 Hz.

    y'' + kd y' + kp y = 0,    y: the error of the virtual constraint

The output y (`trajopt.feedback.constraint`) has relative degree two: y'' is affine in V but for the
kink of friction. The law takes y'' from the model at two voltages and solves for the V that gives
the y'' above. What it does not control is the motion along the constraint, the zero dynamics
(Westervelt, Grizzle and Koditschek, Hybrid zero dynamics of planar biped walkers, IEEE TAC 2003).
"""

from __future__ import annotations

from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import accelerations
from rimless_gym.jit import inner
from trajopt.feedback.constraint import LEG, ConstraintGains, constraint_of, output
from trajopt.feedback.law import Law
from trajopt.gaits.solution import Solution

#: Both roots of s^2 + kd s + kp lie at -5 1/s: half a step to a time constant. In 1/s^2 and 1/s.
#: At -15 1/s half of the walks slip where the law takes over, at `BUILDABLE`'s 0.62 m/s.
KP, KD = 25.0, 10.0


def design(solution: Solution) -> Law:
    """The law for a gait; it raises what `constraint_of` does."""
    constraint = constraint_of(solution)
    data = ConstraintGains(constraint.orbit, constraint, solution.params.constants, KP, KD)
    return Law(solution.params, volts, data)


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    out = output(x, data.constraint, data.constants)
    here = _second_derivative(x, out, out.voltage, data)
    per_volt = _second_derivative(x, out, out.voltage + 1.0, data) - here
    return out.voltage - (here + data.kd * out.dy + data.kp * out.y) / per_volt


@inner
def _second_derivative(x, out, u, data):  # type: ignore[no-untyped-def]
    """y'' (rad/s^2) at a voltage."""
    a = accelerations(SINGLE, x[0], x[1], x[2], x[3], u, data.constants)
    leads = data.constraint.phase == LEG
    other, phase = (a.ddtheta, a.ddphi) if leads else (a.ddphi, a.ddtheta)
    return other - out.slope * phase - out.bend * x[2 + data.constraint.phase] ** 2
