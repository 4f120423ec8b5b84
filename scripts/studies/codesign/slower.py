"""A machine's gaits at given speeds, led there from gaits of other speeds or machines."""

from __future__ import annotations

from collections.abc import Sequence

from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import least_first

#: How many of the known gaits, those of the nearest speeds, are led to a speed.
LED = 3


def at_speed(gait: Solution, speed: float) -> Solution | str:
    """The gait of the same machine at another speed (m/s), or why there is none."""
    return at_speeds(gait.params, speed, (gait,))


def at_speeds(params: WheelParams, speed: float, known: Sequence[Solution]) -> Solution | str:
    """The cheapest gait of a machine at a speed (m/s) to which a known one leads, or why none."""
    found, reason = [], "no gait is known"
    for gait in sorted(known, key=lambda each: abs(each.speed - speed))[:LED]:
        try:
            led = periodic_gait(params, speed, gait.steps, guess=gait)
        except NoGaitError as error:
            reason = str(error)
            continue
        if led.verification.passed:
            found.append(led)
        else:
            reason = "; ".join(led.verification.failures)
    return least_first(found, lambda each: each.cot)[0] if found else reason


def held_gait(gait: Solution) -> Solution | str:
    """The gait that the environment allows, its voltage held, near one that is not; or why none."""
    try:
        return periodic_gait(gait.params, gait.speed, gait.steps, hold=CONTROL_PERIOD, guess=gait)
    except NoGaitError as error:
        return str(error)
