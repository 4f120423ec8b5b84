"""From a guess to a verified solution: ladder, Ctrl-C, guesses, pickles, reports, messages."""

from __future__ import annotations

import dataclasses
import math
import pickle
import signal
import threading
from typing import Any

import numpy as np
import pytest

from trajopt import (
    Constraint,
    Extremal,
    InfeasibleBoundsError,
    Mesh,
    Phase,
    Problem,
    nonnegative,
    solve,
)
from trajopt.ocp import textbook
from trajopt.ocp.guesses import line, polyline, straight_lines
from trajopt.ocp.solve import OPTION_SETS
from trajopt.ocp.transcription import Transcription

FREE = math.inf


def phase(**more: Any) -> Phase:
    return Phase(
        **{
            "name": "move",
            "states": ("x", "v"),
            "controls": ("u",),
            "flow": lambda x, u, p: (x[1], u),
            "start": {"x": 0.0, "v": 0.0},
            "end": {"x": 1.0, "v": 0.0},
            "duration": 1.0,
        }
        | more
    )


def impossible() -> Problem:
    """1 m in 1 s at most at 0.5 m/s."""
    return Problem((phase(bounds={"v": (-FREE, 0.5)}, cost=lambda x, u, p: u**2),))


@pytest.fixture(scope="module")
def swing() -> Extremal:
    return solve(textbook.cart_pole())


# -- the way to a solution ----------------------------------------------------------------------


def test_every_rung_of_the_ladder_is_logged() -> None:
    found = solve(impossible())
    assert not found.converged
    assert [attempt.options for attempt in found.attempts] == [dict(rung) for rung in OPTION_SETS]
    assert not any(attempt.succeeded for attempt in found.attempts)
    assert "retried" in found.report()


def test_a_later_rung_rescues_what_the_first_cannot_do() -> None:
    found = solve(textbook.cart_pole(), passes=0, max_iter=6)
    assert [attempt.succeeded for attempt in found.attempts[:1]] == [False]
    assert found.attempts[-1].options["max_iter"] == 1500
    assert found.attempts[-1].succeeded


def test_a_failure_names_the_phase_the_constraint_the_time_and_the_size() -> None:
    message = solve(impossible(), passes=0).failures[1]
    assert "of phase 'move' at t = " in message
    assert "differential equation of x" in message
    assert "violated by" in message


def test_failures_are_in_capitals_in_the_report() -> None:
    found = solve(impossible(), passes=0)
    assert "FAILED: IPOPT: Infeasible" in found.report()
    assert "FAILED" in repr(found)


@pytest.mark.parametrize("points", [2, 5, 30])
@pytest.mark.parametrize("degree", [3, 6])
def test_the_solution_does_not_depend_on_the_mesh_of_the_guess(
    swing: Extremal, points: int, degree: int
) -> None:
    t = np.linspace(0.0, 2.0, points)
    straight = np.outer(t / 2, swing.phases[0].end)
    found = solve(textbook.cart_pole(), [polyline(t, straight)], Mesh.uniform(1, 8, degree))
    assert found.cost == pytest.approx(swing.cost, rel=1e-8)


def test_a_solution_is_a_guess_that_leads_back_to_itself_at_once(swing: Extremal) -> None:
    again = solve(swing.problem, swing.phases, swing.mesh, passes=0, mu_init=1e-8)
    assert again.cost == pytest.approx(swing.cost, rel=1e-10)
    assert again.attempts[0].iterations <= 5


def test_a_solution_by_one_scheme_is_a_guess_for_another(swing: Extremal) -> None:
    mesh = Mesh.uniform(1, 60, scheme="hermite-simpson")
    found = solve(swing.problem, swing.phases, mesh, passes=0, mu_init=1e-6)
    assert found.cost == pytest.approx(swing.cost, rel=1e-4)
    assert found.attempts[0].iterations <= 10


def test_nothing_is_played_back_unless_asked_for() -> None:
    found = solve(textbook.least_effort_move(), verify=False)
    assert found.resimulation is None
    assert found.cost == found.transcribed_cost
    assert found.converged


def solve_over_and_over() -> None:
    for _ in range(100):
        solve(textbook.cart_pole(), mesh=Mesh.uniform(1, 60, 6), passes=0)


@pytest.mark.parametrize("delay", [0.3, 0.7, 1.1])
def test_ctrl_c_reaches_the_user_through_casadi(delay: float) -> None:
    main = threading.main_thread().ident or 0
    timer = threading.Timer(delay, lambda: signal.pthread_kill(main, signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        solve_over_and_over()
    timer.join()


# -- what a solution is -------------------------------------------------------------------------


def test_problems_survive_pickling() -> None:
    for example in textbook.EXAMPLES:
        problem = pickle.loads(pickle.dumps(example.problem()))
        mesh = Mesh.uniform(problem, 4)
        costs = [
            Transcription(p, mesh).solve(straight_lines(p)).cost
            for p in (problem, example.problem())
        ]
        assert costs[0] == pytest.approx(costs[1], rel=1e-12)


def test_solutions_survive_pickling(swing: Extremal) -> None:
    copy = pickle.loads(pickle.dumps(swing))
    assert copy.cost == swing.cost
    assert copy.converged


def test_states_and_controls_are_found_by_time(swing: Extremal) -> None:
    assert swing.state(0.0) == pytest.approx([0, 0, 0, 0], abs=1e-9)
    assert swing.state(2.0) == pytest.approx([1, math.pi, 0, 0], abs=1e-8)
    ball = solve(textbook.bouncing_ball())
    landing = ball.phases[0].duration
    assert ball.state(landing, "left")[3] == pytest.approx(-ball.phases[0].start[3], rel=1e-8)
    assert ball.state(landing, "right")[3] == pytest.approx(0.8 * ball.phases[0].start[3], rel=1e-8)
    for t in (-0.1, ball.duration + 0.1, math.nan):
        with pytest.raises(ValueError, match=r"must be (from 0 to|finite)"):
            ball.state(t)


def test_a_report_says_what_there_is_to_know() -> None:
    report = solve(textbook.gear()).report()
    for word in ("converged", "cost", "0.48", "radau, 10 elements", "ratio = 5", "Hamiltonian"):
        assert word in report


# -- what is refused, and in which words --------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"bounds": {"v": (1.0, -1.0)}}, "bounds of v: the lower bound 1 exceeds the upper"),
        ({"bounds": {"v": (math.nan, 1.0)}}, "not NaN"),
        (
            {"start": {"x": 2.0}, "bounds": {"x": (0.0, 1.0)}},
            "x is 2.0 at the start, but bounded by",
        ),
        ({"duration": (2.0, 1.0)}, "duration = .* must be positive, lower bound first"),
        ({"duration": 0.0}, "must be positive"),
    ],
)
def test_bounds_without_room_are_refused_before_anything_is_solved(
    wrong: dict[str, Any], message: str
) -> None:
    with pytest.raises(InfeasibleBoundsError, match=message):
        phase(**wrong)


def test_durations_parameters_and_constraints_without_room_are_refused() -> None:
    with pytest.raises(InfeasibleBoundsError, match="own bounds add up to 1 to 1 s"):
        Problem((phase(),), duration=3.0)
    with pytest.raises(InfeasibleBoundsError, match="bounds of mass: the lower bound"):
        Problem((phase(),), parameters={"mass": (2.0, 1.0)})
    with pytest.raises(InfeasibleBoundsError, match="tight: the lower bound"):
        Constraint(lambda x, u, p: u, np.ones(1), np.zeros(1), ("tight",))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"bounds": {"w": 1.0}}, r"bounds names \['w'\], which are not among"),
        ({"end": {"u": 1.0}}, r"end names \['u'\], which are not among \('x', 'v'\)"),
        ({"flow": lambda x, u, p: (x[1],)}, "flow gives 1 rates for the 2 states"),
        (
            {"path": nonnegative(lambda x, u, p: (u, u), "one")},
            r"path gives 2 numbers for its 1 names \('one',\)",
        ),
        ({"cost": lambda x, u, p: (u, u)}, "cost gives 2 numbers, not one"),
    ],
)
def test_wrong_names_and_shapes_are_refused_by_name(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Problem((phase(**wrong),))


def test_meshes_that_do_not_fit_are_refused() -> None:
    problem = textbook.bouncing_ball()
    with pytest.raises(ValueError, match="mesh has 1 phases, the problem 3"):
        Transcription(problem, Mesh.uniform(1))
    with pytest.raises(ValueError, match="scheme = 'euler': choose from"):
        Mesh.uniform(1, scheme="euler")
    with pytest.raises(ValueError, match="must increase from 0 to 1"):
        Mesh(((0.0, 0.5, 0.5, 1.0),), ((3, 3, 3),))
    with pytest.raises(ValueError, match="give one for each of the 2 elements"):
        Mesh(((0.0, 0.5, 1.0),), ((3,),))
    with pytest.raises(ValueError, match="one number for all 3 phases, or one for each"):
        Mesh.uniform(problem, [1, 2])


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        ([], "0 trajectories for the 1 phases"),
        ([line(np.zeros(3), np.ones(3), np.zeros(1), 1.0)], "'move': 3 states and 1 controls"),
        ([line(np.zeros(2), np.ones(2), np.zeros(2), 1.0)], "'move': 2 states and 2 controls"),
    ],
)
def test_guesses_that_do_not_fit_are_refused(guess: list[Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        solve(Problem((phase(),)), guess)


def test_straight_lines_are_within_all_bounds() -> None:
    problem = Problem(
        (
            phase(bounds={"u": (2.0, FREE), "x": (-1.0, 5.0)}, start={"x": (0.0, 2.0)}, end={}),
            phase(name="free", start={}, end={}, duration=(0.5, 0.7)),
        ),
        duration=(0.0, 9.0),
    )
    first, second = straight_lines(problem)
    assert first.start == pytest.approx([1.0, 0.0])
    assert first.controls.ravel() == pytest.approx([2.0, 2.0])
    assert second.duration == pytest.approx(0.7)
    moved = dataclasses.replace(problem, duration=1.6)
    assert sum(t.duration for t in straight_lines(moved)) == pytest.approx(1.7, abs=0.2)
