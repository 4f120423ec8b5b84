"""Gaits that were found once and now start every search near them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.solution import Solution
from trajopt.ocp.solving.ties import least_first

#: Guesses whose distances in speed differ by less than this (m/s) are judged by their CoT.
NEAR = 0.02

FOLDER = Path(__file__).parent / "library"


@lru_cache
def shipped() -> tuple[Solution, ...]:
    """The gaits in the package, in order of file name."""
    return tuple(Solution.load(path) for path in sorted(FOLDER.glob("*.npz")))


def nearest(params: WheelParams, speed: float, steps: int) -> list[Solution]:
    """Shipped gaits of as many steps and legs: of each family, by turns of theta, the nearest.

    Nearest in machine, then in speed.
    """
    fitting = [s for s in shipped() if s.steps == steps and s.params.n_legs == params.n_legs]
    families: dict[int, Solution] = {}

    def distance(solution: Solution) -> tuple[int, float]:
        differing, gap = _distance(solution, params, speed)
        return differing, round(gap, 6)  # m/s: two that are as far but for rounding are

    for solution in sorted(fitting, key=distance):
        families.setdefault(solution.theta_turns, solution)
    return list(families.values())


def leads_for(params: WheelParams, speed: float, steps: int) -> list[Solution]:
    """Shipped gaits to start from, the most promising first.

    Shorter strides that divide `steps` count as repeated. Of those about as near in speed, the
    cheaper is the more promising.
    """
    leads = []
    for divisor in range(1, steps + 1):
        if steps % divisor == 0:
            found = nearest(params, speed, divisor)
            leads += [repeated(solution, steps // divisor) for solution in found]
    return by_promise(leads, params, speed)


def by_promise(leads: Sequence[Solution], params: WheelParams, speed: float) -> list[Solution]:
    """Guesses sorted by machine, by speed to within `NEAR`, then by their families' costs.

    A family is what has as many turns of the pendulum. It counts by its gait nearest in speed, for
    a slower one of the same family costs less and is no better a guess.
    """

    def nearness(solution: Solution) -> tuple[int, int]:
        differing, gap = _distance(solution, params, speed)
        return differing, round(gap / NEAR - 1e-3)  # round speeds are not on the brink

    def gap(solution: Solution) -> float:
        return round(_distance(solution, params, speed)[1], 6)

    families: dict[tuple[tuple[int, int], int], list[Solution]] = {}
    for lead in sorted(least_first(leads, lambda lead: lead.cot), key=gap):
        families.setdefault((nearness(lead), lead.theta_turns), []).append(lead)
    ranked = least_first(families.values(), lambda family: family[0].cot)
    ranked.sort(key=lambda family: nearness(family[0]))
    return [lead for family in ranked for lead in family]


def _distance(solution: Solution, params: WheelParams, speed: float) -> tuple[int, float]:
    mine, theirs = (dataclasses.asdict(p) for p in (params, solution.params))
    return sum(mine[name] != theirs[name] for name in mine), abs(solution.speed - speed)


def repeated(solution: Solution, times: int) -> Solution:
    """The same gait with strides `times` as long; its verification is that of one stride."""
    turns, phases = solution.theta_turns, []
    for stride in range(times):
        turned = np.array([0.0, 2 * math.pi * turns * stride, 0.0, 0.0])
        phases += [dataclasses.replace(p, states=p.states + turned) for p in solution.phases]
    return dataclasses.replace(solution, phases=tuple(phases), theta_turns=turns * times)
