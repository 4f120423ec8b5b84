"""Whether the motor can feed the losses of a walk at all: a bound that no gait can beat.

Over a stride the mechanical energy changes only by the work of the slope, and plastic touchdowns
take energy. So what the motor delivers at the hub, less the friction there, and what the slope
gives, must on average cover the air drag at least. Two things are known of every gait:

- the leg turns by n alpha in a stride of n steps, so air drag, whose power is convex in phi',
  takes at least its power at the mean rate;
- psi turns by n alpha (0 with the frame mount) and a whole number of turns of theta, so |psi'| is
  on average at least the least of these over the stride's duration.

Where the power at the hub falls with psi', the second bounds it: by weak duality the mean of
g(|psi'|) with a mean of |psi'| >= m is at most max_x [g(x) + k (x - m)] for every k >= 0.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rimless_gym.equations import PLASTIC, equations
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)

#: Rates psi' (rad/s) at which the power at the hub is tabulated: up to the fastest of a gait.
_RATES = np.append(0.0, np.geomspace(1e-4, 2 * MAX_RATE, 4000))

#: Share of the terms by which they must fail to balance, far more than the table's errors.
_CERTAIN = 1e-3

#: The fields that take energy, of which an error names those that do.
_COSTLY = ("hub_damping", "hub_friction", "drag", "slope")


def lacks_power(params: WheelParams, speed: float, steps: int) -> str:
    """Why no voltage within the limit makes this machine walk at this speed; empty if one might.

    It is sure where it says so; it may be silent where there is no gait all the same.

    Args:
        params: the machine.
        speed: mean speed (m/s).
        steps: touchdowns per stride.
    """
    p = params.constants
    if p.law != PLASTIC:  # other touchdowns may create energy
        return ""
    mean = least_mean_rate(params, speed, steps)
    hub = most_power_at_hub(params, mean)
    turning = p.alpha * speed / params.step_length
    drag = float(_eq.air_drag(turning, p)) * turning
    slope = params.weight * math.sin(params.slope) * speed
    if hub + slope >= drag - _CERTAIN * (abs(hub) + abs(slope) + drag):
        return ""
    costly = [f", {name} = {getattr(params, name):g}" for name in _COSTLY if getattr(params, name)]
    return (
        f"speed = {speed:g} m/s: the motor is too weak. With |psi'| of at least {mean:.3g} rad/s "
        f"on average, voltage_limit = {params.voltage_limit:g} V{''.join(costly)}, friction at the "
        f"hub leaves it at most {hub:.4g} W. The slope adds {slope:.4g} W, and air drag takes "
        f"{drag:.4g} W, which is more than both: lower the losses, raise voltage_limit, or try "
        "another speed"
    )


def least_mean_rate(params: WheelParams, speed: float, steps: int) -> float:
    """The least mean of |psi'| (rad/s) that a stride of so many steps can have at this speed."""
    wheel = params.constants.d1 * steps * params.leg_angle
    duration = steps * params.step_length / speed
    return abs(math.remainder(wheel, 2 * math.pi)) / duration


def most_power_at_hub(params: WheelParams, mean: float) -> float:
    """The largest mean power (W) that reaches wheel and pendulum if |psi'| >= `mean` on average."""
    p = params.constants
    friction = p.F0 * _eq.slide(_RATES, p)  # the least there can be: without load
    torque = _eq.hub_torque(_RATES, params.voltage_limit, p) - friction
    power: NDArray[np.float64] = _RATES * torque
    near = min(int(np.searchsorted(_RATES, mean)), len(_RATES) - 2)
    falling = (power[near] - power[near + 1]) / (_RATES[near + 1] - _RATES[near])
    price = max(falling, 0.0)
    return float(np.max(power + price * (_RATES - mean)))
