"""PD about a gait on its phase: a servo of the motor's angle, at 100 Hz.

    V = V*(s) - K (kp (psi - psi*(s)) + kd (psi' - psi*'(s)))

The thesis (5.1.3) proposes PID about the trajectory. psi is the angle that the motor turns, from
the leg to the pendulum, and K the motor's back-EMF. The phase s is where the gait's pendulum points
as the wheel's does (`trajopt.feedback.constraint`). At the same phase, the error of psi is that of
the other angle. There is no I term: an integral is memory, a law is a function of the state alone,
and the voltage that it would have to find is known.
"""

from __future__ import annotations

from rimless_gym.jit import inner
from trajopt.feedback.constraint import PENDULUM, ConstraintGains, constraint_of, output
from trajopt.feedback.law import Law
from trajopt.gaits.solution import Solution

#: Volts per rad of the motor's angle and per rad/s of its rate, in units of the back-EMF's K (V s).
KP, KD = 400.0, 10.0


def design(solution: Solution) -> Law:
    """The law for a gait; it raises what `constraint_of` does, and where a servo cannot hold it."""
    constraint, constants = constraint_of(solution), solution.params.constants
    if solution.params.motor_mount == "frame" and constraint.phase == PENDULUM:
        raise ValueError(
            "solution: its motor_mount = 'frame' turns the pendulum, whose angle is the phase, so "
            "that the motor's angle has no error; take another law, such as 'lqr'"
        )
    if constraint.authority < 0.0:
        raise ValueError(
            "solution: a voltage that turns its motor forwards moves the wheel backwards off its "
            "path, so that a servo of the motor drives it away; take another law, such as 'lqr'"
        )
    kp, kd = constants.K * KP, constants.K * KD
    data = ConstraintGains(constraint.orbit, constraint, constants, kp, kd)
    return Law(solution.params, volts, data)


@inner
def volts(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage for a state (4,)."""
    out = output(x, data.constraint, data.constants)
    return out.voltage - data.kp * out.y - data.kd * out.motor_rate_error
