"""Lower bounds on the cost of transport of a family of gaits, in closed form.

docs/bounds.md has the derivation.
"""

from __future__ import annotations

import math
from typing import Any

from rimless_gym.equations import equations
from rimless_gym.params import WheelParams

_eq = equations(math.sin, math.cos)

#: The friction x^2 / sqrt(x^2 + w^2) is convex up to its inflection, beyond which it approaches
#: |x| from below. Its convex envelope leaves it where its slope is 1, at this |x| / w.
ENVELOPE = math.sqrt((math.sqrt(5) - 1) / 2)

#: The line of slope 1 that goes on from there lies this much, times w, below |x|.
BELOW = ENVELOPE - ENVELOPE**2 / math.sqrt(ENVELOPE**2 + 1)


def cot_bound(
    params: WheelParams,
    *,
    speed: float,
    steps: int,
    theta_turns: int,
    regeneration: bool = False,
) -> float:
    """A cost of transport below which no gait of a speed and family can walk.

    It holds for every periodic motion, through double stance and backward steps as well, and for
    every voltage, held or not. It is rigorous but for rounding.

    Args:
        params: the machine.
        speed: mean speed along the ground (m/s), > 0.
        steps: net steps per stride, >= 1.
        theta_turns: whole turns that theta gains in a stride.
        regeneration: bound E / (weight * distance), of a battery that takes energy back, not E+.

    Returns:
        The bound; infinite if the motor cannot supply the losses at this speed. Impact laws
        other than "plastic" may create energy: only the idle power remains, or -inf for E.
    """
    floor = -math.inf if regeneration else 0.0
    power = floor
    if params.impact_law == "plastic":
        needed = least_losses(params, speed, theta_turns / steps) - _descent(params, speed)
        power = max(_least_supply(params, needed), floor)
    return (params.idle_power + power) / (params.weight * speed)


def least_losses(params: WheelParams, speed: float, turns_per_step: float) -> float:
    """Least mean power (W) of all losses but copper in a periodic motion of given mean rates.

    Each loss is at least its convex envelope at the mean rate, by Jensen's inequality. Those of
    copper and gear are 0 there, because the motor may coast.

    Args:
        params: the machine.
        speed: mean speed (m/s).
        turns_per_step: turns that theta gains per step.
    """
    c = params.constants
    dpsi = mean_rates(params, speed, turns_per_step)[2]
    end = ENVELOPE * c.w
    tangent = _losses(params, speed, turns_per_step, min(dpsi, end)).friction
    friction = tangent + c.F0 * max(dpsi - end, 0.0)
    return float(_smooth_losses(params, speed, turns_per_step, dpsi) + friction)


def motor_deficit(params: WheelParams, speed: float, turns_per_step: float) -> float:
    """Mean power (W) that the motor is short of, at its voltage limit, in a periodic motion.

    What the motor can do beyond friction and damping is concave in |psi'|, so its mean is at most
    that at the mean rate, or at the faster rate at which it is largest. If that is less than the
    other losses, there is no such motion; if it is not, that does not prove that there is one.

    Args:
        params: the machine.
        speed: mean speed (m/s).
        turns_per_step: turns that theta gains per step.

    Returns:
        Not positive if nothing is short; -inf where the impact law may create energy.
    """
    if params.impact_law != "plastic":
        return -math.inf
    c, volts = params.constants, params.voltage_limit
    braking = c.damping + c.K**2 / c.Rm
    best = (_eq.motor_torque(0.0, volts, c) - c.F0) / (2 * braking) if braking else 0.0
    rate = max(mean_rates(params, speed, turns_per_step)[2], best)
    needed = _smooth_losses(params, speed, turns_per_step, rate) - _descent(params, speed)
    friction = c.F0 * max(rate - BELOW * c.w, 0.0)
    return float(needed + friction - _eq.shaft_power(rate, volts, c))


def _smooth_losses(params: WheelParams, speed: float, turns_per_step: float, dpsi: float) -> float:
    """Least mean power (W) of damping, drag and windage, at this size of psi' (rad/s)."""
    losses = _losses(params, speed, turns_per_step, dpsi)
    dtheta = mean_rates(params, speed, turns_per_step)[1]
    return float(losses.damping + losses.drag + _eq.windage(dtheta, params.constants) * dtheta)


def _losses(params: WheelParams, speed: float, turns_per_step: float, dpsi: float) -> Any:
    """The losses of a coasting machine at its mean phi' and this size of psi' (rad/s)."""
    c = params.constants
    dphi = mean_rates(params, speed, turns_per_step)[0]
    return _eq.losses(dphi, dpsi, 0.0, _eq.motor_voltage(dpsi, 0.0, c), c)


def mean_rates(
    params: WheelParams, speed: float, turns_per_step: float
) -> tuple[float, float, float]:
    """Mean phi' and theta', and the size of the mean psi' (rad/s); see `least_losses`."""
    c = params.constants
    steps_per_second = speed / c.chord
    dphi, dtheta = c.alpha * steps_per_second, 2 * math.pi * turns_per_step * steps_per_second
    return dphi, dtheta, abs(_eq.relative_rate(dphi, dtheta, c))


def _least_supply(params: WheelParams, needed: float) -> float:
    """Least mean electrical power (W) of which `needed` (W) is left after the copper loss.

    The current is at least electrical power / voltage limit, so a mean power P loses at least
    P^2 / S in copper, where S is the power that a stalled motor draws.
    """
    stall = _eq.electrical_power(0.0, params.voltage_limit, params.constants)
    left = 1 - 4 * needed / stall
    return math.inf if left < 0 else 2 * needed / (1 + math.sqrt(left))


def _descent(params: WheelParams, speed: float) -> float:
    """Mean power (W) of gravity down the slope."""
    return float(_eq.descent(0.0, params.constants)) * speed / params.step_length
