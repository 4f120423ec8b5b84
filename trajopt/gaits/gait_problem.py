"""The optimal control problem of a periodic gait: least electrical energy at a given speed."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache

from rimless_gym.checks import flag, integer, positive
from rimless_gym.params import WheelParams
from rimless_gym.presets import Machine, as_params
from trajopt.gaits.stance import WheelPhases
from trajopt.ocp.problem import Problem
from trajopt.ocp.refinement import MAX_ELEMENTS

#: Most turns of theta in a stride, either way; more than the fastest whirls make in a minute.
MOST_TURNS = 600


def gait_problem(
    params: Machine,
    *,
    speed: float,
    steps: int,
    theta_turns: int = 0,
    regeneration: bool = False,
) -> Problem:
    """The problem of a periodic gait: `steps` single-stance phases in a ring, least energy.

    Problems of one machine and number of steps differ only in numbers, and share their functions.

    Args:
        params: the machine, or a preset's name.
        speed: mean speed along the ground (m/s), imposed through the stride's duration.
        steps: touchdowns per stride.
        theta_turns: whole turns that theta gains in a stride.
        regeneration: whether the battery takes energy back.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: a number is out of its range.
    """
    params = as_params(params)
    positive("speed", speed)
    integer("steps", steps, 1, MAX_ELEMENTS)
    integer("theta_turns", theta_turns, -MOST_TURNS, MOST_TURNS)
    flag("regeneration", regeneration)
    return posed(_ring(params, steps), params, speed, theta_turns, regeneration)


def posed(
    ring: Problem, params: WheelParams, speed: float, theta_turns: int, regeneration: bool
) -> Problem:
    """A `gait_problem` of the same machine and steps with other numbers; shares its functions."""
    turns = {"theta": -2 * math.pi * theta_turns}
    floor = -math.inf if regeneration else params.idle_power
    return dataclasses.replace(
        ring,
        phases=tuple(dataclasses.replace(phase, floor=floor) for phase in ring.phases),
        linkages=(*ring.linkages[:-1], dataclasses.replace(ring.linkages[-1], offset=turns)),
        duration=len(ring.phases) * params.step_length / speed,
    )


@lru_cache(maxsize=8)
def _ring(params: WheelParams, steps: int) -> Problem:
    wheel = WheelPhases(params)
    step = wheel.single_stance()
    links = [wheel.touchdown(i, (i + 1) % steps) for i in range(steps)]
    return Problem((step,) * steps, tuple(links))
