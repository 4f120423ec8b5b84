"""The search of a front: what it tries, how it continues after a kill, and what it publishes."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from scripts.studies.fronts import command, rests, solving, strides
from scripts.studies.fronts.results import (
    PlaceResults,
    SearchResults,
    continuations,
    disagreements,
    families,
    midpoints,
    one_step,
)
from scripts.studies.fronts.search import FineMeshes, FrontSearch, different
from scripts.studies.fronts.solving import (
    Continuation,
    Joint,
    Place,
    RandomStarts,
    SearchGait,
    SolveAttempt,
    Task,
    attempts,
)
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.gaits.library import ARCHIVE, index, repeated, shipped
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.store import Store

#: Spacing of the simulated searches' speeds (m/s).
GRID = 0.2


def known(speed: float = 0.5, turns: int = -1) -> Solution:
    ours = [e for e in index() if (e.params, e.steps) == (THESIS_PHYSICAL, 1)]
    gaits = [e for e in ours if e.theta_turns == turns]
    return min(gaits, key=lambda e: abs(e.speed - speed)).load()


def found(speed: float, cot: float, turns: int = -1, steps: int = 1) -> SearchGait:
    """A gait with the first element of a real one as every phase, which keeps its file small."""
    (phase,) = known().phases
    short = dataclasses.replace(
        phase, edges=phase.edges[:2], states=phase.states[:1], controls=phase.controls[:1]
    )
    origin = f"seed 0, random start 0 at {speed:g} m/s"
    return SearchGait(speed, turns, cot, (short,) * steps, origin)


def imagined(task: Task) -> list[SolveAttempt]:
    """Gaits of one turn backwards, whose cost grows with speed, up to 0.6 m/s; no others."""
    place = task.place
    gait = found(place.speed, round(0.01 + 0.1 * place.speed, 6), -1, place.steps)
    there = gait if place.speed < 0.6 else None
    if not isinstance(task, RandomStarts):
        return [SolveAttempt(-1, task.key, there)]
    made = []
    for turns, _, starts in task.families:
        made += [SolveAttempt(turns, None, there if turns == -1 else None)] * starts
    return made


@pytest.fixture(autouse=True)
def quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not wait for the disk; no test cuts the power."""
    monkeypatch.setattr(os, "fsync", lambda file: None)


class Imagined:
    """Solves nothing, and is stopped after so many tasks."""

    def __init__(self, most: float = math.inf) -> None:
        self.most, self.tasks = most, list[Task]()

    def __call__(
        self, function: Any, tasks: Iterable[Any], progress: str
    ) -> Iterator[tuple[Any, Any]]:
        for task in tasks:
            if len(self.tasks) >= self.most:
                raise KeyboardInterrupt
            self.tasks.append(task)
            yield task, imagined(task)


@pytest.fixture
def results(tmp_path: Path) -> SearchResults:
    return SearchResults(THESIS_PHYSICAL, Store(tmp_path))


def again(results: SearchResults) -> SearchResults:
    return SearchResults(THESIS_PHYSICAL, results.store)


# -- agreement ------------------------------------------------------------------------------------


def test_two_seeds_differ_by_what_the_larger_cost_exceeds_the_smaller() -> None:
    gaps = disagreements({0.2: 0.10, 0.3: 0.05}, {0.2: 0.11, 0.3: 0.05})
    assert gaps == {0.2: pytest.approx(0.1), 0.3: 0.0}
    assert disagreements({0.2: 0.1}, {0.3: 0.1}) == {0.2: math.inf, 0.3: math.inf}


def test_speeds_are_added_where_a_front_is_steep_or_ends() -> None:
    grid, front = [0.1, 0.2, 0.3, 0.4], {0.1: 0.10, 0.2: 0.11, 0.3: 0.2}
    assert midpoints(grid, front, 0.05) == pytest.approx([0.25, 0.35])
    assert midpoints(grid, front, 0.1) == []


# -- results and what is left to be tried ---------------------------------------------------------


def test_results_read_again_are_the_same(results: SearchResults) -> None:
    place = Place(0, 0.5, 1)
    results.add(
        place,
        (
            SolveAttempt(-1, None, found(0.5, 0.03)),
            SolveAttempt(0, None, None),
            SolveAttempt(-1, "another gait", found(0.5, 0.02)),
        ),
    )
    here = again(results).at(place)
    assert here == results.at(place)
    assert [gait.cot for gait in here.gaits] == [0.02, 0.03]
    assert here.starts == {-1: (1, 1), 0: (1, 0)}
    assert here.known == {"another gait"}
    assert (here.gaits[0].phases[0].states == found(0.5, 0.02).phases[0].states).all()


def test_a_gait_found_twice_is_listed_once() -> None:
    here = PlaceResults(Place(0, 0.5, 1)).with_gait(found(0.5, 0.03))
    assert here.with_gait(found(0.5, 0.03 * (1 + 1e-5))) == here
    assert len(here.with_gait(found(0.5, 0.03, turns=-2)).gaits) == 2


def test_a_side_is_given_up_at_the_first_family_whose_first_start_fails(
    results: SearchResults,
) -> None:
    place = Place(0, 0.5, 1)
    for task in one_step(0, results, [0.5]):
        assert isinstance(task, RandomStarts)
        results.add(place, imagined(task)[: 2 if task.families[0][0] == -1 else None])
    results.add(place, [SolveAttempt(-2, None, None)])
    backwards = [
        task.families
        for task in one_step(0, results, [0.5], rounds=2)
        if isinstance(task, RandomStarts) and task.families[0][0] < 0
    ]
    assert backwards == [((-1, 2, 2),)]


def test_families_of_more_steps_lie_within_a_turn_per_step_of_a_good_one_step_gait(
    results: SearchResults,
) -> None:
    results.save(PlaceResults(Place(0, 0.5, 1)).with_gait(found(0.5, 0.03)))
    results.save(PlaceResults(Place(0, 0.2, 1)).with_gait(found(0.2, 0.05, turns=-5)))
    assert set(families(results, Place(0, 0.5, 2))) == {0, -1, -2, -3}
    assert 1 not in families(results, Place(0, 0.5, 3))


def test_a_gait_that_was_continued_to_a_speed_is_not_continued_back(
    results: SearchResults,
) -> None:
    results.save(PlaceResults(Place(0, 0.5, 1)).with_gait(found(0.5, 0.03)))
    results.widen([0.45, 0.5, 0.55])
    there = continuations(0, results)
    assert [task.place.speed for task in there] == [0.45, 0.55]
    results.add(there[0].place, imagined(there[0]), source=0.5)
    assert [task.place.speed for task in continuations(0, results)] == [0.55]


# -- the search -----------------------------------------------------------------------------------


def test_an_interrupted_search_goes_on_without_what_it_had_finished(tmp_path: Path) -> None:
    whole, first, second = Imagined(), Imagined(40), Imagined()
    results = SearchResults(THESIS_PHYSICAL, Store(tmp_path / "whole"))
    assert FrontSearch(results, GRID, whole)() == pytest.approx(0.0)
    assert results.costs(0) == results.costs(1) == results.costs(2)
    assert max(results.costs(0)) == pytest.approx(0.6 - GRID / 4)
    parts = SearchResults(THESIS_PHYSICAL, Store(tmp_path / "parts"))
    with pytest.raises(KeyboardInterrupt):
        FrontSearch(parts, GRID, first)()
    parts = again(parts)
    FrontSearch(parts, GRID, second)()
    assert not {repr(task) for task in first.tasks} & {repr(task) for task in second.tasks}
    assert len(first.tasks) + len(second.tasks) == len(whole.tasks)
    assert parts.costs(2) == results.costs(2)
    # Damaged results are searched again.
    (tmp_path / "whole" / "search" / "seed0_1_steps_0.4000.json").write_bytes(b"damaged")
    repair = Imagined()
    FrontSearch(again(results), GRID, repair)()
    assert {task.place for task in repair.tasks} == {Place(0, 0.4, 1)}


def solved(task: Task) -> SearchGait | None:
    (attempt,) = attempts(THESIS_PHYSICAL, task)
    return attempt.gait


def of_search(gait: Solution) -> SearchGait:
    return SearchGait(gait.speed, gait.theta_turns, gait.cot, gait.phases, "shipped")


def test_a_gait_continued_to_another_speed_costs_there_what_a_fine_mesh_gives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gait, other = known(0.5), known(0.55)
    task = Continuation(Place(0, other.speed, 1), of_search(gait))
    there = solved(task)
    assert there is not None
    assert there.speed == other.speed
    assert there.cot == pytest.approx(other.cot, rel=1e-2)
    # One too unstable to be verified does not count.
    monkeypatch.setattr(solving, "MOST_GROWTH", abs(gait.floquet[0]) / 2)
    assert solved(task) is None


def test_joined_steps_add_their_turns() -> None:
    parts = (of_search(known(0.5)), of_search(known(0.45)))
    gait = solved(Joint(Place(0, 0.475, 2), parts))
    assert gait is not None
    assert (gait.turns, gait.steps) == (-2, 2)


def test_a_longer_stride_is_a_shorter_one_and_a_one_step_gait_whose_times_add_up(
    results: SearchResults,
) -> None:
    add(results, {-1: 0.02}, 0.6)
    add(results, {-2: 0.05}, 0.25)
    slow = PlaceResults(Place(2, 0.45, 3)).with_gait(found(0.45, 0.04, turns=-4, steps=3))
    results.save(slow)
    tasks = list(strides.guesses(results, [0.41, 0.46], 4))
    assert {task.place for task in tasks} == {Place(2, 0.46, 4)}
    assert [[part.steps for part in task.parts] for task in tasks] == [[1, 1, 1, 1], [1, 3]]
    for task in tasks:
        results.add(task.place, imagined(task))
    assert not list(strides.guesses(results, [0.46], 4))


# -- fine meshes ----------------------------------------------------------------------------------


def costing(cot: float) -> Solution:
    gait = known()
    energy = gait.verification.electrical_positive * cot / gait.cot
    return dataclasses.replace(
        gait, verification=dataclasses.replace(gait.verification, electrical_positive=energy)
    )


class Verified:
    """A stage that verifies every gait, at a cost of transport that a table gives."""

    def __init__(self, cots: dict[int, float]) -> None:
        self.cots, self.stored = cots, dict[str, Solution | str]()

    def __call__(self, name: str, tasks: dict[str, Any], work: Any) -> dict[str, Solution | str]:
        for key, (_, gait) in tasks.items():
            cot = self.cots.get(gait.turns)
            self.stored.setdefault(key, "none" if cot is None else costing(cot))
        return {key: self.stored[key] for key in tasks}


def add(results: SearchResults, cots: dict[int, float], speed: float = 0.5) -> None:
    here = PlaceResults(Place(2, speed, 1))
    for turns, cot in cots.items():
        here = here.with_gait(found(speed, cot, turns))
    results.save(here)


def test_gaits_are_solved_finely_until_the_next_could_not_cost_less(
    results: SearchResults,
) -> None:
    add(results, {-1: 0.02, -2: 0.03, -3: 0.04, -4: 0.05})
    run = Verified({-2: 0.045, -3: 0.041})
    done = FineMeshes(results, run)()
    assert [key.split("_")[2] for key in run.stored] == ["k-1", "k-2", "k-3"]
    assert [gait.cot for gait in done] == pytest.approx([0.045, 0.041])


def test_a_speed_without_a_verified_gait_gets_one_from_its_neighbours(
    results: SearchResults,
) -> None:
    add(results, {-1: 0.02})
    add(results, {-2: 0.01}, 0.6)
    fine = FineMeshes(results, Verified({-1: 0.02}))
    fine()
    (there,) = [gait for gait, _ in fine.verified() if gait.speed == 0.6]
    assert there.turns == -1
    assert there.origin.endswith("continued from 0.5 m/s on a fine mesh")


def test_repeated_strides_are_not_solved_finely(results: SearchResults) -> None:
    add(results, {-1: 0.03})
    results.save(PlaceResults(Place(2, 0.5, 2)).with_gait(found(0.5, 0.03, turns=-2, steps=2)))
    results.save(PlaceResults(Place(2, 0.5, 3)).with_gait(found(0.5, 0.02, turns=-3, steps=3)))
    assert [gait.steps for gait in different(results, 0.5)] == [3, 1]


# -- what is published ----------------------------------------------------------------------------


def test_a_gait_of_less_cost_that_was_shipped_before_stays() -> None:
    old, costlier = known(0.5), costing(2 * known(0.5).cot)
    assert command.chosen([costlier, old]) == [old]
    assert command.chosen([costlier]) == [costlier]
    with pytest.raises(NoGaitError, match="verification"):
        command.chosen([])


def test_long_strides_are_shipped_only_where_no_shorter_one_costs_less() -> None:
    old, costlier = known(0.5), costing(2 * known(0.5).cot)
    assert command.chosen([repeated(costlier, 4), old]) == [old]
    assert [gait.steps for gait in command.chosen([repeated(old, 4), costlier])] == [1, 4]


@pytest.mark.slow
def test_a_stride_that_rests_longer_costs_the_idle_power_of_the_rest() -> None:
    slow = next(e for e in index() if (e.params, e.steps, e.speed) == (BUILDABLE, 3, 0.1)).load()
    slower = rests.continued_to(slow, 0.09)
    assert isinstance(slower, Solution)
    assert slower.verification.passed
    assert slower.verification.spans > slower.steps
    assert slower.speed == pytest.approx(0.09)
    longer = slower.duration - slow.duration
    assert slower.cost - slow.cost == pytest.approx(BUILDABLE.idle_power * longer, rel=1e-6)


def test_the_section_and_the_figure_are_made_and_the_gaits_shipped(
    results: SearchResults, tmp_path: Path
) -> None:
    gain = FrontSearch(results, GRID, Imagined())()
    gaits = [known(speed) for speed in (0.45, 0.5)]
    front = CotFront(tuple(gaits))
    assert "the two seeds agree everywhere" in command.summary("TRIAL", results, gain)
    assert "| 0.45 |" in command.section("TRIAL", front)
    assert command.drawn("TRIAL", front).axes
    for count in (2, 1):
        command.ship(tmp_path / "gaits.zip", "TRIAL", gaits[:count])
        assert len(command.gait_files(tmp_path / "gaits.zip")) == count


def test_a_stride_is_continued_where_it_should_cost_less_and_no_work_is_done_twice() -> None:
    gait = min(shipped_front(BUILDABLE).envelope, key=lambda gait: abs(gait.speed - 0.2))
    assert rests.distance_to_rest(gait.phases)[0] < rests.NEAR_REST
    tasks = dict(rests.continuations([gait], gait.steps, [0.15, 0.2, 0.3, 0.4], set()))
    assert sorted(speed for _, speed in tasks.values()) == [0.15, 0.3]
    assert not dict(rests.continuations([gait], gait.steps, [0.15, 0.2, 0.3], set(tasks)))
    rested = dict(rests.continuations(shipped(BUILDABLE), gait.steps, [0.15, 0.2], set()))
    assert not rested  # the stride there rests longer already
    shorter = rests.resting_shorter(gait.phases, 1.0)
    duration = sum(phase.duration for phase in shorter)
    assert duration == pytest.approx(gait.duration - 1.0, abs=2 * rests.REST_ELEMENT)


def test_no_gait_of_a_front_lies_below_its_convex_hull_with_rest() -> None:
    front = shipped_front(BUILDABLE)
    speeds = np.array([0.0, *(gait.speed for gait in front.envelope)])
    power = np.array([BUILDABLE.idle_power, *command.hull(front) * speeds[1:] * BUILDABLE.weight])
    walking = [gait.cot * gait.speed * BUILDABLE.weight for gait in front.envelope]
    assert np.all(np.diff(np.diff(power) / np.diff(speeds)) > -1e-9)
    assert np.all(power[1:] <= np.array(walking) + 1e-12)
    assert np.isclose(power[1:], walking).sum() >= 2


def test_an_archive_written_again_is_the_same(tmp_path: Path) -> None:
    command.write_archive(tmp_path / "gaits.zip", command.gait_files(ARCHIVE))
    assert (tmp_path / "gaits.zip").read_bytes() == ARCHIVE.read_bytes()


def test_shipped_gaits_that_stop_cost_less_than_the_front_as_the_page_says() -> None:
    front = shipped_front(THESIS_PHYSICAL)
    gaits = [gait for gait in shipped(THESIS_PHYSICAL) if gait.double_stance]
    assert all(gait.cot < float(front(gait.speed)) for gait in gaits)
    assert strides.stops_section(front, gaits) in (command.DOCS / "front.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_a_periodic_gait_never_costs_more_than_the_searched_front(share: float) -> None:
    gaits = [g for p in (BUILDABLE, THESIS_PHYSICAL) for g in shipped_front(p).envelope]
    best = gaits[round(share * (len(gaits) - 1))]
    gait = periodic_gait(best.params, best.speed, best.steps)
    assert gait.verification.passed
    assert gait.cot <= best.cot * 1.005
