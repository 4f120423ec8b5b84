"""Lengthen the strides of a machine's shipped gaits, up to 20 steps, and ship what costs less.

Below the speed of least cost, a stride of several fast steps and a slow one, in which the pendulum
turns more often, costs less than even steps: part of the time the wheel walks at a speed that suits
it. A stride of n steps is guessed from fast one-step gaits and a slow one, and from a stride of
n - 1 steps and a one-step gait.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path

import numpy as np

from agents.cli.main import run as run_command
from agents.cli.options import Count, Preset
from rimless_gym.presets import as_params
from scripts.studies.fronts.command import WINDOWS, chosen, publish, run_tasks, ship
from scripts.studies.fronts.results import STEPS, SearchResults, neighbours
from scripts.studies.fronts.search import LAST, FineMeshes, Run
from scripts.studies.fronts.solving import (
    Continuation,
    Joint,
    Place,
    Polished,
    SearchGait,
    Task,
    attempts,
)
from trajopt.gaits.library import ARCHIVE, shipped
from trajopt.store import Store

#: Speeds (m/s) at which strides are lengthened: the slowest, and their distance; the fastest is
#: that of least cost.
SLOWEST, SPACING = 0.35, 0.025

#: Guesses of a speed, a number of steps and a way to join: those of least estimated cost, if it is
#: less than this times the least known. Their time may be wrong by this share.
GUESSES, PROMISING, WRONG_TIME = 2, 1.02, 0.05


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return run_command(strides, arguments, "python -m scripts.studies strides")


def strides(
    *, preset: Preset = "BUILDABLE", workers: Count | None = None, out: Path = Path("runs/strides")
) -> int:
    """Lengthen the strides of a machine's shipped gaits, and ship those that cost less.

    Args:
        preset: machine.
        workers: processes; by default one for every core.
        out: folder of the search.
    """
    params = as_params(preset)
    gaits = [gait for gait in shipped(params) if not gait.regeneration]
    known = [gait for gait in gaits if gait.steps <= STEPS[-1] and not gait.double_stance]
    with Store(out / preset, {"params": params.to_dict()}) as store:
        results = SearchResults(params, store)
        fine = FineMeshes(results, partial(run_tasks, workers))
        for gait in known:
            there = SearchGait(
                round(gait.speed, 4), gait.theta_turns, gait.cot, gait.phases, "shipped"
            )
            results.save(results.at(Place(LAST, there.speed, gait.steps)).with_gait(there))
            fine.done[there.key] = Polished(there, gait, "")
        lengthen(results, fine.run)
        for most in reversed(WINDOWS):
            while fine.solve(f"fine meshes: up to {most} steps", fine.best(most)):
                pass
    ship(ARCHIVE, preset, chosen(fine.done.values(), gaits))
    publish(preset)
    return 0


def lengthen(results: SearchResults, run: Run) -> None:
    """Solve longer and longer strides at all speeds up to that of least cost.

    Args:
        results: with the gaits to start from; the others are added.
        run: solves tasks.
    """
    costs = results.costs(LAST)
    fastest = min(costs, key=lambda speed: costs[speed])
    results.widen([*costs, *np.arange(SLOWEST, fastest, SPACING).tolist()])
    speeds = [speed for speed in results.grid if SLOWEST <= speed < fastest]
    plans: list[Callable[[], Iterable[Task]]] = [lambda: continuations(results, speeds)]
    plans += [partial(guesses, results, speeds, n) for n in range(STEPS[-1] + 1, WINDOWS[-1] + 1)]
    for plan in plans:
        tasks = list(plan())
        title = f"strides of {tasks[-1].place.steps} steps" if tasks else ""
        for task, made in run(partial(attempts, results.params), tasks, title):
            results.add(task.place, made)


def continuations(results: SearchResults, speeds: Iterable[float]) -> Iterator[Task]:
    """The neighbours' best gait of every number of steps, for speeds that have none."""
    for place in [Place(LAST, speed, steps) for speed in speeds for steps in STEPS]:
        for speed in neighbours(results.grid, place.speed):
            for gait in results.at(place._replace(speed=speed)).gaits[:1]:
                if not results.at(place).gaits:
                    yield Continuation(place, gait)


def guesses(results: SearchResults, speeds: Iterable[float], steps: int) -> Iterator[Task]:
    """Joints that promise a low cost: of one-step gaits, all but one alike; of a stride and one."""
    L, found = results.params.step_length, list(results.of_seed(LAST))
    ones = [gait for here in found if here.place.steps == 1 for gait in here.gaits]
    shorter = [gait for here in found if here.place.steps == steps - 1 for gait in here.gaits]
    alike = [(*(one,) * (steps - 1), other) for one, other in itertools.permutations(ones, 2)]
    offers = [
        (
            sum(part.steps * part.cot for part in parts) / steps,
            sum(part.steps * L / part.speed for part in parts),
            parts,
        )
        for parts in [*alike, *itertools.product(ones, shorter)]
    ]
    least = results.costs(LAST)
    for place in [Place(LAST, speed, steps) for speed in speeds]:
        duration = steps * L / place.speed
        best: dict[tuple[int, int], tuple[float, Joint]] = {}
        for cost, time, parts in offers:
            if abs(time / duration - 1) <= WRONG_TIME:
                kind = len(parts), sum(part.turns for part in parts)
                if kind not in best or cost < best[kind][0]:
                    best[kind] = cost, Joint(place, parts)
        highest = PROMISING * least.get(place.speed, math.inf)
        for length in (steps, 2):
            ranked = sorted((best[kind] for kind in best if kind[0] == length), key=itemgetter(0))
            for cost, joint in ranked[:GUESSES]:
                if cost <= highest and joint.key not in results.at(place).known:
                    yield joint
