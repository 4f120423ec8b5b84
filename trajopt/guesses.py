"""Gaits that were found once and now start every search near them."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache
from pathlib import Path

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.solution import Solution

FOLDER = Path(__file__).parent / "guesses"


@lru_cache
def shipped() -> tuple[Solution, ...]:
    """The gaits in the package, in order of file name."""
    return tuple(Solution.load(path) for path in sorted(FOLDER.glob("*.npz")))


def nearest(
    params: WheelParams, speed: float, steps: int, regeneration: bool = False
) -> list[Solution]:
    """Shipped gaits of as many steps and legs, nearest in machine, then in speed, first.

    One of each family, by the turns of the pendulum.
    """

    def distance(solution: Solution) -> tuple[float, float, bool, float]:
        mine, theirs = (dataclasses.asdict(p) for p in (params, solution.params))
        differing = sum(mine[name] != theirs[name] for name in mine)
        other_objective = solution.regeneration != regeneration
        return differing, round(abs(solution.speed - speed), 6), other_objective, solution.cot

    fitting = [s for s in shipped() if s.steps == steps and s.params.n_legs == params.n_legs]
    families: dict[int, Solution] = {}
    for solution in sorted(fitting, key=distance):
        families.setdefault(solution.theta_turns, solution)
    return list(families.values())


def leads_for(
    params: WheelParams, speed: float, steps: int, regeneration: bool = False
) -> list[Solution]:
    """Shipped gaits to start from; shorter strides that divide `steps` count as repeated."""
    leads = []
    for divisor in range(1, steps + 1):
        if steps % divisor == 0:
            found = nearest(params, speed, divisor, regeneration)
            leads += [repeated(solution, steps // divisor) for solution in found]
    return leads


def repeated(solution: Solution, times: int) -> Solution:
    """The same gait with strides `times` as long; its verification is that of one stride."""
    turns, phases = solution.theta_turns, []
    for stride in range(times):
        turned = np.array([0.0, 2 * math.pi * turns * stride, 0.0, 0.0])
        phases += [dataclasses.replace(p, states=p.states + turned) for p in solution.phases]
    return dataclasses.replace(solution, phases=tuple(phases), theta_turns=turns * times)
