"""Gaits shipped with the package, from which searches near them start."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import least_first

#: Gaits whose distances in speed differ by less than this (m/s) are ranked by their CoT.
NEAR = 0.02

FOLDER = Path(__file__).parent / "library"


@lru_cache
def shipped() -> tuple[Solution, ...]:
    """The shipped gaits, in order of file name."""
    return tuple(Solution.load(path) for path in sorted(FOLDER.glob("*.npz")))


def nearest(params: WheelParams, speed: float, steps: int) -> list[Solution]:
    """The shipped gaits of as many steps that are nearest: by legs, by machine, then by speed.

    One for every number of turns of theta.
    """
    fitting = [s for s in shipped() if s.steps == steps]
    least = min((_legs_apart(s, params) for s in fitting), default=0)
    fitting = [s for s in fitting if _legs_apart(s, params) == least]
    families: dict[int, Solution] = {}

    def distance(solution: Solution) -> tuple[int, float]:
        differing, gap = _distance(solution, params, speed)
        return differing, round(gap, 6)  # m/s; rounding must not decide between equal distances

    for solution in sorted(fitting, key=distance):
        families.setdefault(solution.theta_turns, solution)
    return list(families.values())


def leads_for(params: WheelParams, speed: float, steps: int) -> list[Solution]:
    """Shipped gaits to start from, the most promising first; see `by_promise`.

    A shorter stride whose number of steps divides `steps` is repeated.
    """
    leads = []
    for divisor in range(1, steps + 1):
        if steps % divisor == 0:
            found = nearest(params, speed, divisor)
            leads += [repeated(solution, steps // divisor) for solution in found]
    return by_promise(leads, params, speed)


def by_promise(leads: Sequence[Solution], params: WheelParams, speed: float) -> list[Solution]:
    """Gaits sorted by distance in machine, by distance in speed to within `NEAR`, then by cost.

    The cost that counts is a family's, all gaits of one number of turns of the pendulum: it is that
    of its gait nearest in speed. A slower gait of the family costs less and is no better a guess.
    """

    def nearness(solution: Solution) -> tuple[int, int]:
        differing, gap = _distance(solution, params, speed)
        return differing, round(gap / NEAR - 1e-3)  # shifted, so that round speeds are not on edge

    def gap(solution: Solution) -> float:
        return round(_distance(solution, params, speed)[1], 6)

    families: dict[tuple[tuple[int, int], int], list[Solution]] = {}
    for lead in sorted(least_first(leads, lambda lead: lead.cot), key=gap):
        families.setdefault((nearness(lead), lead.theta_turns), []).append(lead)
    ranked = least_first(families.values(), lambda family: family[0].cot)
    ranked.sort(key=lambda family: nearness(family[0]))
    return [lead for family in ranked for lead in family]


def _legs_apart(solution: Solution, params: WheelParams) -> int:
    """By how many legs a gait's machine differs."""
    return abs(solution.params.n_legs - params.n_legs)


def _distance(solution: Solution, params: WheelParams, speed: float) -> tuple[int, float]:
    mine, theirs = (dataclasses.asdict(p) for p in (params, solution.params))
    return sum(mine[name] != theirs[name] for name in mine), abs(solution.speed - speed)


def repeated(solution: Solution, times: int) -> Solution:
    """The same gait with `times` strides as one; its verification remains that of one stride."""
    turns, phases = solution.theta_turns, []
    for stride in range(times):
        turned = np.array([0.0, 2 * math.pi * turns * stride, 0.0, 0.0])
        phases += [dataclasses.replace(p, states=p.states + turned) for p in solution.phases]
    return dataclasses.replace(solution, phases=tuple(phases), theta_turns=turns * times)
