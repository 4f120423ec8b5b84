"""The gap of a walk: its cost of transport over that of the environment's own optimum, minus 1.

The environment's own optimum is the best periodic gait of 1 to 3 steps per stride whose voltage is
held for its control period: at any speed, or at that of the walk. A step of such a gait lasts a
whole number of periods; at the speeds in between, the cost of transport is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from agents.conditions import Conditions
from agents.evaluate import Evaluation
from rimless_gym.envs.task import USUAL_TASK
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt import NoGaitError, Solution
from trajopt.gaits.fronts import CotFront, NoFrontError, cot_front, shipped_front
from trajopt.gaits.held_stride import MOST_TICKS, held_speed

#: Steps per stride of the gaits that gaps are measured against.
FRONT_STEPS = (1, 2, 3)

#: Control intervals by which the length of a step is first varied where no gaits are shipped.
FIRST_CHANGE = 8


def gap_to_optimum(
    params: WheelParams, cot: float, speed: float, folder: Path, progress: bool = True
) -> float | None:
    """The gap at the walk's own speed (m/s), with gaits solved now; None without a walk or a gait.

    Gaits that are in the folder are loaded.
    """
    found = [best_held(params, n, folder, progress) for n in ticks_around(params, speed)]
    gaits = tuple(gait for gait in found if gait is not None)
    return gap_to_front(cot, speed, CotFront(gaits)) if len(gaits) > 1 else None


def gap_to_front(cot: float | None, speed: float | None, front: CotFront) -> float | None:
    """The gap to a front of gaits; None off the front or without a walk."""
    speeds = [gait.speed for gait in front.envelope]
    if cot is None or speed is None or not speeds[0] - 1e-9 <= speed <= speeds[-1] + 1e-9:
        return None
    return cot / float(front(speed)) - 1.0


def gap_to_continuous_optimum(evaluation: Evaluation, conditions: Conditions) -> float:
    """The gap of a policy to the shipped gaits, whose voltage may change at any time.

    Linear interpolation between them is right to about 1 %. The environment's own optimum is about
    0.5 % above them. It is NaN where the policy does not walk, at speeds that the gaits do not
    reach, for machines without shipped gaits, and with ranges or commanded speeds.
    """
    if math.isnan(evaluation.speed) or conditions.commanded or conditions.ranges.bounds:
        return math.nan
    try:
        front = shipped_front(conditions.params)
    except NoFrontError:
        return math.nan
    gap = gap_to_front(evaluation.cot, evaluation.speed, front)
    return math.nan if gap is None else gap


def reward_rate(gait: Solution) -> float:
    """The reward per second (m/s) of walking on a gait, in `RimlessWheel-v0`."""
    return (USUAL_TASK.distance_weight - gait.cot) * gait.speed


def ticks_around(params: WheelParams, speed: float | None) -> tuple[int, ...]:
    """The two whole numbers of control intervals per step whose speeds enclose `speed` (m/s).

    None without a speed, or if it is not positive.
    """
    if speed is None or not speed > 0.0:
        return ()
    # at a gait's own speed, rounding must not decide between its neighbours
    fewest = math.floor(params.step_length / (speed * CONTROL_PERIOD) + 1e-9)
    return fewest, fewest + 1


def best_at_any_speed(
    params: WheelParams,
    near: float | None,
    folder: Path,
    progress: bool = True,
    steps: Sequence[int] = FRONT_STEPS,
) -> Solution | None:
    """The held gait with the least CoT, by a pattern search over the length of a step.

    It starts from the best shipped gait, whose number of steps it keeps; where none of the machine
    are shipped, from the speed `near` (m/s). It finds a local optimum.

    Returns:
        The gait; None without a speed to start from, or if there is no gait near it.
    """
    change = FIRST_CHANGE
    try:
        known = min(shipped_front(params).envelope, key=lambda gait: gait.cot)
        near, steps, change = held_speed(params, known.speed, 1, CONTROL_PERIOD), [known.steps], 1
    except NoFrontError:
        pass
    gaits: dict[int, Solution | None] = {}

    def cot(ticks: int) -> float:
        if ticks not in gaits:
            gaits[ticks] = best_held(params, ticks, folder, progress, steps)
        gait = gaits[ticks]
        return math.inf if gait is None else gait.cot

    for best in ticks_around(params, near)[:1]:
        while change:
            other = min((best - change, best + change), key=cot)
            if cot(other) < cot(best):
                best = other
            else:
                change //= 2
        return gaits[best]
    return None


def best_held(
    params: WheelParams,
    ticks: int,
    folder: Path,
    progress: bool = True,
    steps: Sequence[int] = FRONT_STEPS,
) -> Solution | None:
    """The best gait whose steps last so many control intervals; None if there is none.

    It has as many steps per stride as the best one with a continuous voltage. Gaits that are in the
    folder are loaded.
    """
    if not 2 <= ticks <= MOST_TICKS // max(FRONT_STEPS):
        return None
    folder.mkdir(parents=True, exist_ok=True)
    speed = params.step_length / (ticks * CONTROL_PERIOD)
    try:
        free = cot_front(params, [speed], steps, folder=folder, progress=progress)
        (best,) = free.envelope
        held = cot_front(
            params, [speed], [best.steps], hold=CONTROL_PERIOD, folder=folder, progress=progress
        )
    except NoGaitError:
        return None
    return held.envelope[0]
