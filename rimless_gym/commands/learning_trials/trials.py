"""What the simplest policies do: steady voltages, and random smooth policies."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.evolution.policy import SIZE
from agents.evolution.screening import random_policies
from agents.evolution.walks import Duration, World
from agents.evolution.worth import WHOLE, Worth, families, members, stepping
from agents.rollout import draw_starts
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams

#: Voltages that are held for ever, in shares of the limit, and the starts of each.
STEADY, STEADY_STARTS = np.round(np.linspace(-0.8, 0.8, 17), 2), 64

#: Random policies, and the starts of each.
RANDOM, RANDOM_STARTS = 10_000, 4

#: Walks of steady voltages and of random policies.
LONG, SHORT = Duration.judged_in_second_half(2000), Duration.judged_in_second_half(600)


class Steady(NamedTuple):
    """Walks under a steady voltage.

    Attributes:
        share: of the voltage limit.
        falls: share of the starts that fall.
        steps: share that takes steps forward at the end.
        cot: cost of transport of these; NaN without any.
        speed: of these (m/s).
        reward: what all earn per second at the task's own price (m/s).
    """

    share: float
    falls: float
    steps: float
    cot: float
    speed: float
    reward: float


class Family(NamedTuple):
    """Random policies that walk in a family's gait.

    Attributes:
        turns: of the pendulum per step, forward turns negative.
        policies: that walk so from some start.
        everywhere: that walk so from all.
        cot: least cost of transport of a walk.
    """

    turns: int
    policies: int
    everywhere: int
    cot: float


def steady(params: WheelParams, seed: int = 0) -> list[Steady]:
    """What steady voltages do."""
    weights = np.zeros((len(STEADY), SIZE))
    weights[:, 0] = STEADY
    walks = World(params).walk(weights, draw_starts(params, STEADY_STARTS, seed), LONG)
    task = Task()
    worth = Worth(params, task, speed=math.inf)
    goes, fallen, cots = stepping(walks), walks.lasted < WHOLE, worth.costs(walks, LONG)
    speeds = walks.distance / (LONG.window * CONTROL_PERIOD)
    earned = worth.of(walks, LONG, family=0, price=task.value_of_distance)  # none of them whirls
    found = []
    for k, share in enumerate(STEADY):
        some = goes[k]
        cot = float(np.median(cots[k][some])) if some.any() else np.nan
        speed = float(np.median(speeds[k][some])) if some.any() else np.nan
        falls = float(fallen[k].mean())
        found.append(Steady(float(share), falls, float(some.mean()), cot, speed, float(earned[k])))
    return found


def random(params: WheelParams, seed: int = 0) -> list[Family]:
    """Which families of gaits random smooth policies find, fewest turns first."""
    weights = random_policies(RANDOM, np.random.default_rng((seed, 1)))
    walks = World(params).walk(weights, draw_starts(params, RANDOM_STARTS, (seed, 2)), SHORT)
    cots, found = Worth(params, Task(), speed=math.inf).costs(walks, SHORT), []
    for turns in families(walks).tolist():
        own = members(walks, turns)
        some, everywhere = int(own.any(axis=1).sum()), int(own.all(axis=1).sum())
        found.append(Family(turns, some, everywhere, float(cots[own].min())))
    return found
