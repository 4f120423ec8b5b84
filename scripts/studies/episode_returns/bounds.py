"""What the best gaits would earn if they were walked from an episode's beginning to its end."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.envs.speed import TASK
from rimless_gym.envs.task import USUAL_TASK
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.presets import BUILDABLE
from trajopt.gaits.fronts import cot_front, shipped_front
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array

#: Length of an episode (s).
DURATION = 20.0


def earned(gait: Solution) -> float:
    """The return of 20 s on a gait in `RimlessWheel-v0` (m)."""
    return DURATION * gait.speed * (USUAL_TASK.distance_weight - gait.cot)


def best_gait() -> Solution:
    """The gait of the front that earns most, its voltage held for 10 ms.

    A step of such a gait lasts a whole number of intervals: the best continuous gait lies between
    two of these speeds, and the better one of the two counts.
    """
    best = max(shipped_front(BUILDABLE).envelope, key=earned)
    ticks = BUILDABLE.step_length / (best.speed * CONTROL_PERIOD)
    speeds = [
        BUILDABLE.step_length / (n * CONTROL_PERIOD) for n in (math.floor(ticks), math.ceil(ticks))
    ]
    front = cot_front(BUILDABLE, speeds, [best.steps], hold=CONTROL_PERIOD, progress=True)
    return max(front.envelope, key=earned)


def earned_at(speed: ArrayLike) -> Array:
    """The returns in `RimlessWheelSpeed-v0` of 20 s at commanded speeds (m/s), at the front's CoT.

    A bound: the gaits may change their voltage at any time, and walk from the beginning.
    """
    speeds = np.asarray(speed, dtype=float)
    return DURATION * speeds * (TASK.distance_weight - shipped_front(BUILDABLE)(speeds))
