"""The walking task: the reward, each of its terms a function of a few lines.

A new term is a function here and its place in `TERMS`; a new weight is a field of `Task`. The
environment adds the term to the reward, measurements and logs report it by its name, and the
documentation lists it.
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
    """The weight of distance, and the penalties for slipping and falling; rewards are in metres.

    Attributes:
        distance_weight: reward per metre of travel; it selects the speed on the CoT front.
        fall_penalty: travel forfeited when an episode ends early (m). It is more than a wheel
            gains by the lunge that makes it fall, so that such a lunge is never rewarded.
        slip_penalty: travel forfeited per second of control intervals in which the foot would slip
            (m/s), as though it slid back at this speed. The travel of such an interval is not
            rewarded either, so that a moment that slips is worth less than one at rest.
        horizon: time whose idle energy is part of the penalty for an early end (s): the episodes'
            time limit.
        target_speed: the speed up to which travel is rewarded (m/s), greater than 0; by default
            there is no limit. Going faster than the target is not rewarded, so that with a large
            weight the optimum is the most efficient walk at the target speed.

    With a target speed, there is an allowance: the travel that may still be rewarded. It is a step
    length of the machine when an episode begins, and never more, so that the speed may vary within
    a step. Travel uses it up, and it grows at the target speed. Backward travel counts in full, and
    increases the allowance by as much.

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
            checked = positive if name == "target_speed" else not_negative
            endless = name == "target_speed" and value == math.inf
            object.__setattr__(self, name, math.inf if endless else checked(name, value))


#: The default weight and penalties.
USUAL_TASK = Task()


def rewarded(distance: Any, elapsed: Any, allowance: Any, limit: Any, target_speed: Any) -> Any:
    """The travel that is rewarded in an interval, and the allowance after it (m); see `Task`."""
    if target_speed == math.inf:
        return distance, limit
    travel = min(distance, allowance)
    return travel, min(allowance - travel + target_speed * elapsed, limit)


# The terms. Each takes an interval (`layout.Interval`), what the task needs to know of the machine
# (`layout.TaskParams`) and the `Task`, of numbers or arrays. numba compiles these same lines.


def distance(interval: Any, params: Any, task: Any) -> Any:
    """`distance_weight * rewarded_travel`: the hub's travel along the ground, downhill positive.

    With a `target_speed`, no more is rewarded than the allowance that is left.
    """
    return task.distance_weight * interval.rewarded_travel


def energy(interval: Any, params: Any, task: Any) -> Any:
    """`-E+ / ((m1+m2) g)`, with E+ the energy drawn without regeneration, idle energy included."""
    return -(interval.electrical_positive + interval.idle) / params.weight


def slip(interval: Any, params: Any, task: Any) -> Any:
    """`-distance_weight * (max(rewarded_travel, 0) + slip_penalty * elapsed)` if the foot slips.

    That is where a force in stance or a touchdown's impulse needs more friction than there is.
    The penalty is for the time, not for the excess: where the demand only just exceeds the limit, a
    penalty in proportion to the excess would be less than what the excess saves.
    """
    slips = exceeds(interval.friction_demand, params.friction)
    slips = slips | exceeds(interval.impulse_friction_demand, params.friction)
    back = np.maximum(interval.rewarded_travel, 0.0) + task.slip_penalty * interval.elapsed
    return 0.0 - slips * (task.distance_weight * back)


def end(interval: Any, params: Any, task: Any) -> Any:
    """`-(distance_weight * fall_penalty + horizon * idle_power / ((m1+m2) g))` at an early end.

    Resting costs only idle power. Where the wheel can rest, ending early is never better.
    """
    idle = params.idle_power * task.horizon / params.weight
    return 0.0 - interval.failed * (task.distance_weight * task.fall_penalty + idle)


#: The terms in the order in which they are added, from left to right.
TERMS = (distance, energy, slip, end)

#: Their names in `info`.
TERM_NAMES = tuple(f"reward_{term.__name__}" for term in TERMS)
