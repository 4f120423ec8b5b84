"""From a guess to a verified solution: options, Ctrl-C, guesses; costs without a minimum; ties."""

from __future__ import annotations

import dataclasses
import math
import pickle
import signal
import threading
from typing import Any

import casadi as ca
import numpy as np
import pytest

from scripts.studies import textbook
from tests.trajopt.ocp.problems import FREE, move, solve_once, solved, valley
from trajopt import Extremal, Mesh, Phase, Problem, solve
from trajopt.ocp.guesses import polyline, straight_lines
from trajopt.ocp.ranking import clearly_less, least_first, tied
from trajopt.ocp.solve import OPTION_SETS
from trajopt.ocp.transcription import Transcription


@pytest.fixture
def swing() -> Extremal:
    return solved("cart pole")


def impossible() -> Problem:
    """1 m in 1 s at most at 0.5 m/s."""
    return Problem((move(bounds={"v": (-FREE, 0.5)}, cost=lambda x, u, p: u**2),))


def test_every_set_of_options_is_logged() -> None:
    found = solve_once(impossible())
    assert not found.converged
    assert [attempt.options for attempt in found.attempts] == [dict(each) for each in OPTION_SETS]
    assert not any(attempt.succeeded for attempt in found.attempts)
    assert "retried" in found.report()


def test_a_later_set_of_options_succeeds_where_the_first_fails() -> None:
    found = solve_once(textbook.cart_pole(), max_iter=6)
    assert [attempt.succeeded for attempt in found.attempts[:1]] == [False]
    assert found.attempts[-1].options["max_iter"] == 1500
    assert found.attempts[-1].succeeded


def test_a_failure_names_the_phase_the_constraint_the_time_and_the_size() -> None:
    message = solve_once(impossible()).failures[1]
    assert "of phase 'move' at t = " in message
    assert "differential equation of x" in message
    assert "violated by" in message


def test_a_solution_is_a_guess_that_leads_back_to_itself_at_once(swing: Extremal) -> None:
    again = solve_once(swing.problem, swing.phases, swing.mesh, mu_init=1e-8)
    assert again.cost == pytest.approx(swing.cost, rel=1e-10)
    assert again.attempts[0].iterations <= 5


def test_problems_survive_pickling() -> None:
    for example in textbook.PROBLEMS[::3]:
        problem = pickle.loads(pickle.dumps(example.problem()))
        mesh = Mesh.uniform(problem, 4)
        costs = [
            Transcription(p, mesh).solve(straight_lines(p)).cost
            for p in (problem, example.problem())
        ]
        assert costs[0] == pytest.approx(costs[1], rel=1e-12)


def test_straight_lines_are_within_all_bounds() -> None:
    problem = Problem(
        (
            move(bounds={"u": (2.0, FREE), "x": (-1.0, 5.0)}, start={"x": (0.0, 2.0)}, end={}),
            move(name="free", start={}, end={}, duration=(0.5, 0.7)),
        ),
        duration=(0.0, 9.0),
    )
    first, second = straight_lines(problem)
    assert first.start == pytest.approx([1.0, 0.0])
    assert first.controls.ravel() == pytest.approx([2.0, 2.0])
    assert second.duration == pytest.approx(0.7)
    moved = dataclasses.replace(problem, duration=1.6)
    assert sum(t.duration for t in straight_lines(moved)) == pytest.approx(1.7, abs=0.2)


@pytest.mark.parametrize(("points", "degree"), [(2, 6), (30, 4)])
def test_the_solution_does_not_depend_on_the_mesh_of_the_guess(
    swing: Extremal, points: int, degree: int
) -> None:
    t = np.linspace(0.0, 2.0, points)
    straight = np.outer(t / 2, swing.phases[0].end)
    mesh = Mesh.uniform(1, 8, degree)
    found = solve(textbook.cart_pole(), [polyline(t, straight)], mesh, verify=False)
    assert found.cost == pytest.approx(swing.cost, rel=1e-8)


def test_ctrl_c_reaches_the_user_through_casadi() -> None:
    main = threading.main_thread().ident or 0
    timer = threading.Timer(0.5, lambda: signal.pthread_kill(main, signal.SIGINT))
    timer.start()
    fine = Mesh.uniform(1, 400, 8)
    with pytest.raises(KeyboardInterrupt):
        solve(textbook.cart_pole(), mesh=fine, passes=0, tol=1e-15)  # takes minutes
    timer.join()


@pytest.mark.parametrize("scheme", ["radau", "trapezoid"])
def test_a_phase_without_controls_is_solved(scheme: str) -> None:
    fall = Phase(
        "fall",
        states=("height", "speed"),
        flow=lambda x, u, p: [x[1], -2.0],
        start={"height": 1.0, "speed": 0.0},
        end={"height": 0.0},
        duration=(0.1, 3.0),
    )
    problem = Problem((fall,))
    assert solve(problem, mesh=Mesh.uniform(problem, 3, scheme=scheme)).duration == pytest.approx(1)


# -- costs without a minimum, and saddles -------------------------------------------------------


def drift(cost: Any, **changes: Any) -> Problem:
    """x' = u from x = 0, for 1 s."""
    settings = {"start": {"x": 0.0}, "duration": 1.0, "cost": cost} | changes
    return Problem((Phase("drift", ("x",), lambda x, u, p: u, ("u",), **settings),))


@pytest.mark.parametrize(
    "problem",
    [
        drift(lambda x, u, p: u),
        drift(lambda x, u, p: -(u**2)),
        drift(lambda x, u, p: -ca.exp(x)),
        pytest.param(drift(lambda x, u, p: -ca.log(1 + (x - 1) ** 2)), marks=pytest.mark.slow),
        drift(lambda x, u, p: -1.0, duration=(0.1, math.inf)),
        pytest.param(
            drift(None, powers=lambda x, u, p: u, floor=-math.inf), marks=pytest.mark.slow
        ),
    ],
    ids=["linear", "a maximum", "exponential", "logarithmic", "duration", "powers"],
)
def test_a_cost_without_a_minimum_is_no_success(
    problem: Problem,
) -> None:
    found = solve_once(problem)
    assert not found.converged
    assert "no minimum" in found.outcome


def test_a_function_that_is_not_finite_is_named_with_its_time() -> None:
    phase = Phase(
        "rise",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: 1 / x[0] + u[0],
        cost=lambda x, u, p: u[0] ** 2,
        start={"x": 0.0},
        end={"x": 2.0},
        duration=1.0,
    )
    found = solve(Problem((phase,)), passes=0)
    assert "flow of x of phase 'rise' at t = 0 s is not finite" in found.outcome
    assert math.isfinite(found.cost)


def test_a_derivative_that_is_not_finite_is_named_with_its_time(
    capfd: pytest.CaptureFixture[str],
) -> None:
    tank = Phase(
        "tank",
        states=("level",),
        flow=lambda x, u, p: -ca.sqrt(x[0]),
        start={"level": 1.0},
        end={"level": 0.0},
        duration=(0.1, 10.0),
    )
    outcome = solve(Problem((tank,)), passes=0, option_sets=({},)).outcome
    assert "derivative of flow of level of phase 'tank' at t = " in outcome
    assert capfd.readouterr().err == ""


def test_a_guess_on_a_saddle_leads_away_from_it() -> None:
    found = solve_once(valley(y=(-1.0, 1.0)))
    assert found.cost < -60.0  # the ridge itself costs 1
    assert abs(found.phases[0].state(0.5)[0, 1]) == pytest.approx(1.0, abs=1e-3)


# -- ties ---------------------------------------------------------------------------------------


def test_items_that_clearly_differ_are_in_order_of_cost() -> None:
    assert least_first([3.0, -1.0, 2.0], float) == [-1.0, 2.0, 3.0]


@pytest.mark.parametrize("hair", [-1e-9, 0.0, 1e-9])
def test_of_items_that_tie_the_first_comes_first(hair: float) -> None:
    costs = {"far": 2.0, "first": 1.0, "second": 1.0 + hair, "cheap": 0.5, "third": 1.0 - hair}
    assert least_first(costs, costs.__getitem__) == ["cheap", "first", "second", "third", "far"]
    assert tied(1.0, 1.0 + hair)
    assert not clearly_less(1.0, 1.0 + abs(hair))
