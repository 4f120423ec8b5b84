"""The search, from its first random start to two seeds that agree, last sweeps, and fine meshes.

Everything it finds is in the store. After an interruption the search passes through the same stages
again, and finds that what was done need not be done again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any, TypeAlias

from scripts.studies.fronts import results as plans
from scripts.studies.fronts.results import (
    AGREEMENT,
    STEPS,
    SearchResults,
    disagreements,
    distinct,
    midpoints,
    neighbours,
)
from scripts.studies.fronts.solving import (
    Continuation,
    Place,
    SearchGait,
    Task,
    attempts,
    polish,
)
from trajopt.gaits.periodic import NoGaitError
from trajopt.gaits.problem import fastest_walk
from trajopt.gaits.solution import Solution

#: The two independent seeds, and that of the last sweep, which begins with what both have found.
SEEDS, LAST = (0, 1), 2

#: Longest step (s): a slower wheel stands balanced on one leg, for as long as one likes.
LONGEST_STEP = 5.0

#: The upper end of the walks is reached where so many speeds of the grid in a row have none.
EMPTY = 2

#: Speeds that are screened at a time on the way up.
BATCH = 4

#: Every so many speeds of the grid one is screened with random starts; gaits are continued to the
#: others.
SCREENED = 2

#: The shortest distance between speeds is the grid's spacing divided by this.
FINEST = 4

#: Rounds of random starts of one-step gaits near the envelope, beyond the first screening.
MORE_STARTS = 3

#: Most rounds of more random starts where the two seeds disagree, and most last sweeps.
ROUNDS, SWEEPS = 4, 3

#: Gaits are near the envelope if they cost less than this times it; at most so many of a speed.
NEAR_FRONT, MOST = 1.25, 3

#: A stride that costs as much as a shorter one that it may repeat (relative) is not solved finely.
REPEATED = 2e-3

#: Most gaits of one speed that are solved finely in search of its best, and that are continued to
#: there.
TRIED, CONTINUED = 5, 6

#: (function, tasks, progress=title) -> every task with its result, as `trajopt.pool.run`.
Run: TypeAlias = Callable[..., Iterator[tuple[Any, Any]]]


class FrontSearch:
    """The stages of a search over speeds of a spacing (m/s), with more where the front is steep."""

    def __init__(self, results: SearchResults, spacing: float, run: Run) -> None:
        self.results, self.spacing, self.run = results, spacing, run

    def __call__(self) -> float:
        """Search; by how much the last sweep beat what was known, at most (relative)."""
        self.two_seeds()
        return self.last_sweeps()

    def two_seeds(self) -> None:
        """Both seeds, each independently, until they agree."""
        screened = self._one_step()
        title = "1 step near the envelope"
        self._solve(SEEDS, title, plans.near_envelope, screened, STEPS[:1], MORE_STARTS)
        self._settle(SEEDS)
        self._solve(SEEDS, "joined steps", plans.joints)
        self._solve(SEEDS, "2 and 3 steps", plans.more_steps, screened)
        self._settle(SEEDS)
        for number in range(1, ROUNDS + 1):
            gaps = disagreements(*(self.results.costs(seed) for seed in SEEDS))
            speeds = [speed for speed, gap in gaps.items() if gap > AGREEMENT]
            if not speeds:
                return
            title = f"{len(speeds)} speeds of disagreement, round {number}"
            self._solve(SEEDS, title, plans.near_envelope, speeds, STEPS, MORE_STARTS + number)
            self._solve(SEEDS, title, plans.more_steps, speeds, number)
            self._solve(SEEDS, "joined steps", plans.joints)
            self._settle(SEEDS)

    def last_sweeps(self) -> float:
        """Fresh starts and continuation from what both seeds found, until nothing better comes."""
        self._unite()
        gain, seeds = math.inf, list(SEEDS)
        for number in range(1, SWEEPS + 1):
            before = self.results.costs(*seeds)
            self._solve((LAST,), "joined steps", plans.joints)
            everywhere = self.results.grid, STEPS, number
            self._solve((LAST,), f"sweep {number}", plans.near_envelope, *everywhere)
            self._settle((LAST,))
            after, seeds = self.results.costs(LAST), [*SEEDS, LAST]
            gain = max(1 - after[speed] / before.get(speed, math.inf) for speed in after)
            if gain <= AGREEMENT:
                break
        return gain

    def _unite(self) -> None:
        """Give the last sweep what both seeds found and continued."""
        for speed, steps in product(self.results.grid, STEPS):
            before = united = self.results.at(Place(LAST, speed, steps))
            for seeds in [self.results.at(Place(seed, speed, steps)) for seed in SEEDS]:
                united = dataclasses.replace(united, known=united.known | seeds.known)
                for gait in seeds.gaits:
                    united = united.with_gait(gait)
            if united != before:
                self.results.save(united)

    def _one_step(self) -> list[float]:
        """Screen one-step gaits from slow to fast; the speeds that were screened."""
        tops = []
        for seed in SEEDS:
            speeds: list[float] = []
            while not self._above(seed, speeds):
                speeds = self._multiples(len(speeds) + BATCH)
                self._solve((seed,), f"1 step, to {speeds[-1]:g} m/s", plans.one_step, speeds)
            tops.append(len(speeds))
        screened = self._multiples(max(tops))
        self._solve(SEEDS, "1 step", plans.one_step, screened)
        speeds = list(self.results.envelope(*SEEDS))
        if not speeds:
            raise NoGaitError(
                f"no gait of one step was found from {screened[0]:g} to {screened[-1]:g} m/s: "
                "give the machine a higher voltage limit or friction"
            )
        walks = [v for v in screened if speeds[0] <= v <= speeds[-1]]
        between = [v + i * self.spacing for v in walks for i in range(1, SCREENED)]
        self.results.widen([*screened, *between])
        self._settle(SEEDS)
        return walks

    def _multiples(self, count: int) -> list[float]:
        """So many of the speeds that are screened, from the slowest up."""
        params = self.results.params
        first = math.ceil(params.step_length / LONGEST_STEP / self.spacing - 1e-9)
        speeds = [round((first + SCREENED * i) * self.spacing, 4) for i in range(count)]
        return [speed for speed in speeds if speed <= fastest_walk(params)]

    def _above(self, seed: int, speeds: Sequence[float]) -> bool:
        """Whether these speeds reach beyond the fastest walk."""
        walked = [bool(self.results.at(Place(seed, v, 1)).gaits) for v in speeds]
        at_end = bool(speeds) and speeds == self._multiples(len(speeds) + 1)
        return at_end or (any(walked) and not any(walked[-EMPTY:]))

    def _settle(self, seeds: Sequence[int]) -> None:
        """Continue gaits, with more speeds where the front is steep, until nothing is left."""
        refining = LAST not in seeds  # new speeds are for both seeds
        for number in range(1, 100):
            if self._solve(seeds, f"continuation, round {number}", plans.continuations):
                continue
            costs = self.results.costs(*SEEDS)
            steep = midpoints(self.results.grid, costs, self.spacing / FINEST)
            if not (refining and self.results.widen(steep)):
                return

    def _solve(
        self, seeds: Sequence[int], title: str, plan: Callable[..., list[Task]], *arguments: Any
    ) -> int:
        """Solve what a plan leaves to be tried by each of these seeds; how many tasks these are."""
        count, solve = 0, partial(attempts, self.results.params)
        for seed in seeds:
            tasks = plan(seed, self.results, *arguments)
            for task, made in self.run(solve, tasks, progress=f"seed {seed}: {title}"):
                source = task.gait.speed if isinstance(task, Continuation) else None
                self.results.add(task.place, made, source)
            count += len(tasks)
        return count


# -- fine meshes ----------------------------------------------------------------------------------


class FineMeshes:
    """The search's gaits on fine meshes, best first: only those that are verified are the front.

    The search's mesh is coarse, and some gaits seem to cost less on it than they do. So at every
    speed the gaits are solved finely in the order of their cost on the search's mesh, until the
    next one could not cost less than the best that is verified. Where none is, or where it costs
    more than on the search's mesh, verified gaits of the neighbouring speeds are continued to there
    on fine meshes.
    """

    def __init__(self, results: SearchResults, stage: Callable[..., dict[str, Any]]) -> None:
        self.results, self.stage = results, stage  # see `stages.stage`
        self.done: dict[str, tuple[SearchGait, Solution | str]] = {}

    def __call__(self) -> list[Solution]:
        """The front, and the other gaits that are worth shipping."""
        while self.solve(self.best()):
            pass
        while self.solve(self.beside()):
            pass
        self.solve(self.others())
        return [solution for _, solution in self.verified()]

    def solve(self, gaits: Iterable[SearchGait]) -> int:
        """Solve gaits finely; how many were new."""
        before, by_key = len(self.done), {gait.key: gait for gait in gaits}
        tasks = {key: (self.results.params, gait) for key, gait in by_key.items()}
        found = self.stage("fine", tasks, polish)
        self.done |= {key: (gait, found[key]) for key, gait in by_key.items()}
        return len(self.done) - before

    def verified(self) -> list[tuple[SearchGait, Solution]]:
        """The gaits that passed their verification, and their solutions on fine meshes."""
        return [(gait, each) for gait, each in self.done.values() if isinstance(each, Solution)]

    def best(self, most: int = STEPS[-1]) -> list[SearchGait]:
        """At every speed the next gait of up to so many steps, if it may be that of least cost."""
        gaits = []
        for speed in self.results.envelope(LAST):
            ranked, least = different(self.results, speed, most)[:TRIED], self._least(speed, most)
            gaits += [g for g in ranked if g.key not in self.done and g.cot < least][:1]
        return gaits

    def beside(self) -> list[SearchGait]:
        """Verified gaits to continue to a neighbouring speed without one, or with one of more cost.

        Each stands at the new speed with the cost and the motion of the old one.
        """
        costs, gaits = self.results.costs(LAST), list[SearchGait]()
        for speed in costs:
            if self._least(speed) <= (1 + AGREEMENT) * costs[speed]:
                continue
            near = neighbours(list(costs), speed)
            known = [(gait, each) for gait, each in self.verified() if gait.speed in near]
            for gait, solution in sorted(known, key=lambda pair: pair[1].cot)[:CONTINUED]:
                origin = f"{gait.origin.split('; ')[0]}; continued from {gait.speed:g} m/s"
                there = SearchGait(
                    speed, gait.turns, solution.cot, solution.phases, f"{origin} on a fine mesh"
                )
                gaits += [there] if there.key not in self.done else []
        return gaits

    def others(self) -> list[SearchGait]:
        """Gaits worth shipping beside the front.

        At the speeds that were screened with random starts the best of each number of steps and the
        best without turns; at all speeds those near the envelope.
        """
        screened: list[SearchGait] = []
        near: list[SearchGait] = []
        for speed, best in self.results.envelope(LAST).items():
            gaits = different(self.results, speed)
            if any(self.results.at(Place(seed, speed, 1)).starts for seed in SEEDS):
                kinds = [[g for g in gaits if g.steps == steps] for steps in STEPS]
                kinds.append([g for g in gaits if g.turns == 0])
                screened += [kind[0] for kind in kinds if kind]
            near += [gait for gait in gaits if gait.cot <= NEAR_FRONT * best.cot][:MOST]
        return list({gait.key: gait for gait in (*screened, *near)}.values())

    def _least(self, speed: float, most: int = STEPS[-1]) -> float:
        """The cost of the best verified gait of up to so many steps at a speed, or infinity."""
        at_speed = [pair for pair in self.verified() if pair[0].speed == speed]
        costs = [solution.cot for gait, solution in at_speed if gait.steps <= most]
        return min(costs, default=math.inf)


def different(results: SearchResults, speed: float, most: int = STEPS[-1]) -> list[SearchGait]:
    """The best gait of every family of a speed, best first, without repeated shorter strides."""
    gaits: list[SearchGait] = []
    for steps in range(1, most + 1):
        for gait in distinct(results.at(Place(LAST, speed, steps)).gaits):
            if not any(_repeats(gait, shorter) for shorter in gaits):
                gaits.append(gait)
    return sorted(gaits, key=lambda g: (g.cot, g.steps))


def _repeats(gait: SearchGait, shorter: SearchGait) -> bool:
    times, rest = divmod(gait.steps, shorter.steps)
    same = rest == 0 and gait.turns == times * shorter.turns
    return same and gait.cot > (1 - REPEATED) * shorter.cot
