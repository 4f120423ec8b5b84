"""The walking task: what is paid for, each term a function of a few lines.

A new term is a function here and its place in `TERMS`; a new price is a field of `Task`. The
environment pays it, `info` and the logs report it by its name, and the documentation lists it.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from rimless_gym.checks import not_negative, positive
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.rules import exceeds


@dataclasses.dataclass(frozen=True)
class Task:
    """The prices of distance, slipping and an early end; every reward is in metres.

    Attributes:
        distance_weight: reward per metre of travel; it selects the speed on the CoT front.
        fall_penalty: travel forfeited when an episode ends early (m). It is more than a wheel
            gains by the lunge that makes it fall, so that such a lunge does not pay.
        slip_penalty: travel forfeited per second of control intervals in which the foot would slip
            (m/s), as though it slid back at this speed. The travel of such an interval is not paid
            for either, so that a moment that slips is worth less than one at rest.
        horizon: time whose idle energy is charged for an early end (s): the episodes' time limit.
        target_speed: the speed up to which travel is paid (m/s), greater than 0; by default there
            is no limit. Going faster than the target earns nothing more, so that at a high price
            the optimum is the cheapest walk at the target speed.

    With a target speed, there is a credit: the travel that may still be paid. It is a step length
    of the machine when an episode begins, and never more, so that the speed may vary within a step.
    Travel uses it up, and the target speed makes it grow all the time. Backward travel is charged
    in full, and gives back as much credit.

    Raises:
        TypeError: a value is not a number.
        ValueError: a value is negative, not finite or larger than 1e30. The target speed may be
            infinite, but not 0.
    """

    distance_weight: float = 0.5
    fall_penalty: float = 2.0
    slip_penalty: float = 2.0
    horizon: float = EPISODE_STEPS * CONTROL_PERIOD
    target_speed: float = math.inf

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            checked = _target if name == "target_speed" else not_negative
            object.__setattr__(self, name, checked(name, value))


def _target(name: str, value: Any) -> float:
    """A target speed: greater than 0, or infinite."""
    return math.inf if value == math.inf else positive(name, value)


#: The default prices.
USUAL_TASK = Task()


def settled(distance: Any, elapsed: Any, credit: Any, limit: Any, target_speed: Any) -> Any:
    """The travel that is paid in an interval, and the credit afterwards (m); see `Task`."""
    if target_speed == math.inf:
        return distance, limit
    paid = min(distance, credit)
    return paid, min(credit - paid + target_speed * elapsed, limit)


# The terms. Each takes an interval (`layout.Interval`), what the task knows about the machine
# (`layout.Machine`) and the `Task`, of numbers or arrays. numba compiles these same lines.


def distance(interval: Any, machine: Any, task: Any) -> Any:
    """`distance_weight * paid`: the hub's travel dx along the ground, downhill positive.

    With a `target_speed`, no more is paid than the credit that is left.
    """
    return task.distance_weight * interval.paid


def energy(interval: Any, machine: Any, task: Any) -> Any:
    """`-E+ / ((m1+m2) g)`, with E+ the energy drawn without regeneration, idle energy included."""
    return -(interval.electrical_positive + interval.idle) / machine.weight


def slip(interval: Any, machine: Any, task: Any) -> Any:
    """`-distance_weight * (max(paid, 0) + slip_penalty * elapsed)`, where the foot would slip.

    That is where a force in stance or a touchdown's impulse needs more friction than there is.
    The charge is for the time, not for the excess: where the demand only just exceeds the limit, a
    charge in proportion to the excess would be less than what the excess saves.
    """
    slips = exceeds(interval.friction_demand, machine.friction)
    slips = slips | exceeds(interval.impulse_friction_demand, machine.friction)
    back = np.maximum(interval.paid, 0.0) + task.slip_penalty * interval.elapsed
    return 0.0 - slips * (task.distance_weight * back)


def end(interval: Any, machine: Any, task: Any) -> Any:
    """`-(distance_weight * fall_penalty + horizon * idle_power / ((m1+m2) g))` at an early end.

    Resting costs only idle power. Where the wheel can rest, ending early is never better.
    """
    idle = machine.idle_power * task.horizon / machine.weight
    return 0.0 - interval.failed * (task.distance_weight * task.fall_penalty + idle)


#: The terms in the order in which they are summed.
TERMS = (distance, energy, slip, end)

#: What `info` calls them.
TERM_NAMES = tuple(f"reward_{term.__name__}" for term in TERMS)
