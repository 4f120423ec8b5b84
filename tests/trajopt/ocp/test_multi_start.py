"""Searches from many starts: their optima and workers."""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.trajopt.ocp.problems import unit_scales, valley
from trajopt.ocp.constraints import nonnegative, pair
from trajopt.ocp.guesses import Waypoints, line, straight_lines
from trajopt.ocp.multi_start import Outcome, Search, Start, best_of, distinct, multi_start
from trajopt.ocp.problem import Phase, Problem


def clearance(x: ca.SX, u: ca.SX, p: ca.SX) -> Any:
    return [(x[0] - 0.5) ** 2 + (x[1] - 0.05) ** 2 - 0.3**2]


def around(duration: Any = 1.0, speed: float = 10.0) -> Problem:
    """From (0, 0) to (1, 0) past a disc whose centre is a little to the left of the way."""
    way = Phase(
        "way",
        states=("x", "y"),
        controls=("vx", "vy"),
        flow=lambda x, u, p: u,
        cost=lambda x, u, p: ca.sumsqr(u),
        path=nonnegative(clearance, "clearance"),
        bounds={"y": (-1.0, 1.0), "vx": (-speed, speed), "vy": (-speed, speed)},
        start={"x": 0.0, "y": 0.0},
        end={"x": 1.0, "y": 0.0},
        duration=duration,
    )
    return Problem((way,))


AROUND = around()
FAMILY = Waypoints(AROUND)


@pytest.fixture(scope="module")
def search() -> Search:
    return multi_start(AROUND, FAMILY, 12)


def test_both_ways_past_a_disc_are_found_the_shorter_one_first(search: Search) -> None:
    right, left = search.optima[:2]
    assert right.cost < left.cost
    middle = [optimum.phases[0].state(0.5)[0, 1] for optimum in (right, left)]
    assert middle[0] < -0.24
    assert middle[1] > 0.34


def test_every_start_led_to_an_optimum_or_says_why_not(search: Search) -> None:
    found = [index for optimum in search.optima for index in optimum.starts]
    failed = [outcome.index for outcome in search.failures]
    assert sorted(found + failed) == list(range(12))


def test_the_report_says_how_often_each_optimum_was_found(search: Search) -> None:
    share = len(search.optima[0].starts) / 12
    assert f"{share:.1%}" in search.report()


def test_the_best_are_refined_and_verified(search: Search) -> None:
    best, second = best_of(search, 2, verify=False)
    assert best.converged
    assert second.converged
    assert best.cost < second.cost
    assert best.cost == pytest.approx(search.optima[0].cost, rel=0.02)


def test_the_same_seed_gives_the_same_outcomes_whatever_the_number_of_workers(
    search: Search,
) -> None:
    parallel = multi_start(AROUND, FAMILY, 3, workers=2)
    for one, other in zip(search.outcomes, parallel.outcomes, strict=False):
        assert (one.index, one.cost, one.failure) == (other.index, other.cost, other.failure)
        assert np.array_equal(one.phases[0].states, other.phases[0].states)


def test_guesses_are_random_but_the_first_and_stay_within_the_bounds() -> None:
    first, second = (FAMILY(np.random.default_rng([seed, 1]), 1)[0] for seed in (0, 1))
    assert not np.array_equal(first.states, second.states)
    line = straight_lines(AROUND)[0]
    assert np.array_equal(FAMILY(np.random.default_rng(5), 0)[0].states, line.states)
    problem = around(duration=(0.5, 2.0))
    phase = problem.phases[0]
    for index in range(20):
        guess = Waypoints(problem)(np.random.default_rng(index), index)[0]
        lower, upper = phase.state_bounds()
        assert np.all(guess.states >= lower)
        assert np.all(guess.states <= upper)
        lower, upper = phase.control_bounds()
        assert np.all(guess.controls >= lower)
        assert np.all(guess.controls <= upper)
        least, most = pair(phase.duration)
        assert least <= guess.duration <= most


def test_a_problem_without_solutions_yields_none_and_the_reasons() -> None:
    slow = around(speed=0.5)
    search = multi_start(slow, Waypoints(slow), 3)
    assert not search.optima
    assert "NO LOCAL OPTIMUM" in search.report()
    assert all("violated" in outcome.failure for outcome in search.failures)
    assert best_of(search) == ()


@dataclasses.dataclass(frozen=True)
class TwoTurns:
    """The way in two durations, which are different problems and different optima."""

    problem: Problem

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        duration = 1.0 + index % 2
        phase = dataclasses.replace(self.problem.phases[0], duration=duration)
        timed = dataclasses.replace(self.problem, phases=(phase,))
        problems = (self.problem, timed)
        return Start(straight_lines(self.problem), problems=problems, kind=f"{duration:g} s")


def test_starts_may_differ_in_the_numbers_of_their_problem() -> None:
    search = multi_start(AROUND, TwoTurns(AROUND), 4)
    slow, quick = search.optima
    assert (slow.best.kind, quick.best.kind) == ("2 s", "1 s")
    assert slow.cost == pytest.approx(quick.cost / 2, rel=1e-3)
    assert best_of(search)[0].duration == 2.0


@pytest.mark.parametrize("hair", [-1e-10, 0.0, 1e-10])
def test_of_starts_that_led_to_one_optimum_the_first_stands_for_it(hair: float) -> None:
    way = line(np.zeros(1), np.ones(1), np.zeros(1), 1.0)
    mirrored = line(np.zeros(1), -np.ones(1), np.zeros(1), 1.0)
    ends = {4: (way, 1.0), 2: (mirrored, 1.0 + hair), 7: (way, 1.0 - hair), 5: (way, 0.5)}
    outcomes = [
        Outcome(i, "", cost, (end,), np.empty(0), 1, "", unit_scales(1))
        for i, (end, cost) in ends.items()
    ]
    found = [(optimum.best.index, optimum.starts) for optimum in distinct(outcomes)]
    assert found == [(5, (5,)), (2, (2,)), (4, (4, 7))]


def test_a_search_does_not_count_a_saddle_as_an_optimum() -> None:
    problem = valley()
    search = multi_start(problem, Waypoints(problem), 2)
    assert not search.optima
    assert all("Diverging" in outcome.failure for outcome in search.failures)
