"""Lengthen the strides of a machine's shipped gaits, up to 20 steps, and ship what costs less.

Below the speed of least cost, a stride of several fast steps and a slow one, in which the pendulum
turns more often, costs less than even steps: part of the time the wheel walks at a speed that suits
it. A stride of n steps is guessed from fast one-step gaits and a slow one, and from a stride of
n - 1 steps and a one-step gait.

Other strides stop on two feet once. Where the gait of least cost lands softly, that costs little:
the pendulum swings over the hub of a wheel that stands. They are repetitions of that gait with one
stop, solved at slower and slower speeds; the front's other gaits have one foot on the ground.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from agents.cli.options import Count, Preset
from rimless_gym.presets import as_params
from scripts.studies.documents.markdown import marks, refresh, table
from scripts.studies.fronts.command import DOCS, WINDOWS, chosen, publish, ship
from scripts.studies.fronts.results import STEPS, SearchResults, neighbours, promising
from scripts.studies.fronts.search import LAST, FineMeshes, Run
from scripts.studies.fronts.solving import (
    Continuation,
    Place,
    SearchGait,
    Task,
    attempts,
)
from scripts.studies.stages import stage
from trajopt import pool
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.gaits.library import ARCHIVE, repeated, shipped
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.store import Store

#: Speeds (m/s) at which strides are lengthened: the slowest, and their distance; the fastest is
#: that of least cost.
SLOWEST, SPACING = 0.35, 0.025

#: Guesses of a speed, a number of steps and a way to join: those of least estimated cost, if it is
#: less than this times the least known. Their time may be wrong by this share.
GUESSES, PROMISING, WRONG_TIME = 2, 1.02, 0.05

#: Repetitions of the gait of least cost in a stride with one stop, and by how much longer than
#: without it the stride lasts (s).
REPETITIONS, LONGER = (2, 3, 4), (0.03, 0.045, 0.06)


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
        fine = FineMeshes(results, partial(stage, store, workers=workers))
        for gait in known:
            there = SearchGait(
                round(gait.speed, 4), gait.theta_turns, gait.cot, gait.phases, "shipped"
            )
            results.save(results.at(Place(LAST, there.speed, gait.steps)).with_gait(there))
            fine.done[there.key] = there, gait
        lengthen(results, partial(pool.run, workers=workers))
        for most in reversed(WINDOWS[1:]):  # shorter ones at these speeds were not searched
            while fine.solve(fine.best(most)):
                pass
    ship(ARCHIVE, preset, chosen([*(gait for _, gait in fine.verified()), *gaits]))
    publish(preset)
    return 0


def lengthen(results: SearchResults, run: Run) -> None:
    """Solve longer and longer strides at all speeds up to that of least cost, and add them."""
    costs = results.costs(LAST)
    fastest = min(costs, key=lambda speed: costs[speed])
    results.widen([*costs, *np.arange(SLOWEST, fastest, SPACING).tolist()])
    speeds = [speed for speed in results.grid if SLOWEST <= speed < fastest]
    plans: list[Callable[[], Iterable[Task]]] = [lambda: continuations(results, speeds)]
    plans += [partial(guesses, results, speeds, n) for n in range(STEPS[-1] + 1, WINDOWS[-1] + 1)]
    for plan in plans:
        tasks = list(plan())
        title = f"strides of {tasks[-1].place.steps} steps" if tasks else ""
        for task, made in run(partial(attempts, results.params), tasks, progress=title):
            results.add(task.place, made)


def continuations(results: SearchResults, speeds: Iterable[float]) -> Iterator[Task]:
    """The neighbours' best gait of every number of steps, for speeds that have none."""
    for place in [Place(LAST, speed, steps) for speed in speeds for steps in STEPS]:
        for speed in neighbours(results.grid, place.speed):
            for gait in results.at(place._replace(speed=speed)).gaits[:1]:
                if not results.at(place).gaits:
                    yield Continuation(place, gait)


def guesses(results: SearchResults, speeds: Iterable[float], steps: int) -> Iterator[Task]:
    """Joints of low expected cost: of one-step gaits, all but one alike; of a stride and one."""
    found = list(results.of_seed(LAST))
    ones = [gait for here in found if here.place.steps == 1 for gait in here.gaits]
    shorter = [gait for here in found if here.place.steps == steps - 1 for gait in here.gaits]
    alike = [(*(one,) * (steps - 1), other) for one, other in itertools.permutations(ones, 2)]
    for place in [Place(LAST, speed, steps) for speed in speeds]:
        for ways in (alike, itertools.product(ones, shorter)):
            offers = [((sum(part.turns for part in parts),), parts) for parts in ways]
            yield from promising(results, place, offers, GUESSES, PROMISING, WRONG_TIME)


# -- stops ----------------------------------------------------------------------------------------


def stops(*, preset: Preset = "BUILDABLE", workers: Count | None = None) -> int:
    """Ship gaits that stop once in a stride, where they cost less than a machine's front.

    Args:
        preset: machine.
        workers: processes; by default one for every core.
    """
    params = as_params(preset)
    gaits = [gait for gait in shipped(params) if not gait.regeneration]
    front = shipped_front(params)
    for _, found in pool.run(partial(stopping, front), REPETITIONS, workers, progress="stops"):
        gaits += found
    best = chosen(gaits)
    ship(ARCHIVE, preset, best)
    text = stops_section(front, [gait for gait in best if gait.double_stance])
    refresh(DOCS / "front.md", marks("stops", (preset,)), {preset: text})
    return 0


def stops_section(front: CotFront, gaits: Sequence[Solution]) -> str:
    """The table of gaits that stop, beside the front without them."""
    head = ["speed (m/s)", "CoT", "front without stops", "steps", "turns", "on two feet (s)"]
    rows = [
        [
            f"{gait.speed:.4f}",
            f"{gait.cot:.5f}",
            f"{float(front(gait.speed)):.5f}",
            gait.steps,
            gait.theta_turns,
            f"{gait.phases[-1].duration:.3f}",
        ]
        for gait in sorted(gaits, key=lambda gait: (round(gait.speed, 4), gait.steps))
    ]
    return table(head, rows) + "\n"


def stopping(front: CotFront, times: int) -> list[Solution]:
    """Gaits with one stop in so many strides of the front's best gait, if they cost less."""
    best = min(front.envelope, key=lambda gait: gait.cot)
    guess, found = repeated(best, times), list[Solution]()
    for longer in LONGER:
        speed = round(times * best.verification.distance / (times * best.duration + longer), 4)
        try:
            gait = periodic_gait(best.params, speed, guess.steps, double_stance=True, guess=guess)
        except NoGaitError:
            break
        if not gait.verification.passed or gait.cot > float(front(speed)):
            break
        found.append(gait)
        guess = gait
    return found
