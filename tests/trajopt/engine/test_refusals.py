"""What a newcomer and a reviewer got wrong, and what they are told."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest

from trajopt import Phase, Problem, resimulation, solve, textbook
from trajopt.guesses import straight_lines


def falls(**changes: object) -> Phase:
    settings = {"states": ("y", "v"), "flow": lambda x, u, p: (x[1], -9.81)} | changes
    return Phase("fall", **settings)  # type: ignore[arg-type]


def test_functions_of_math_in_a_flow_are_refused() -> None:
    with pytest.raises(ValueError, match="use CasADi's functions"):
        Problem((falls(flow=lambda x, u, p: (x[1], math.sin(x[0]))),))
    Problem((falls(flow=lambda x, u, p: (x[1], ca.sqrt(x[0]))),))  # not a number at times is well


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"states": "yv"}, "give a tuple"),
        ({"states": ("y", "y")}, "everything differently"),
        ({"controls": ("v",)}, "everything differently"),
        ({"states": (), "flow": lambda x, u, p: ()}, "at least one state"),
        ({"start": {"y": math.inf}}, "nothing lies between"),
        ({"duration": math.inf}, "must be positive"),
    ],
)
def test_phases_that_say_nothing_are_refused(changes: dict, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        falls(**changes)


def test_a_problem_without_phases_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Problem(())


def test_a_guess_that_is_not_finite_is_refused() -> None:
    problem = textbook.least_effort_move()
    (line,) = straight_lines(problem)
    with pytest.raises(ValueError, match="must all be finite"):
        solve(problem, [dataclasses.replace(line, states=line.states * np.nan)])


def test_a_solution_is_a_guess() -> None:
    problem = textbook.least_effort_move()
    found = solve(problem, verify=False)
    again = solve(problem, found, found.mesh, verify=False, mu_init=1e-6)
    assert again.attempts[0].iterations <= found.attempts[0].iterations


def test_playing_back_gives_up_on_what_an_explicit_integrator_cannot_follow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(resimulation, "EFFORT", 2000)
    stiff = Phase(
        "stiff",
        states=("x", "y"),
        controls=("u",),
        flow=lambda x, u, p: (u[0], -1e5 * (x[1] - ca.sin(5 * x[0]))),
        cost=lambda x, u, p: u[0] ** 2 + x[1] ** 2,
        start={"x": 0.0, "y": 1.0},
        end={"x": 1.0},
        duration=1.0,
    )
    found = solve(Problem((stiff,)), passes=0)
    assert found.succeeded
    assert not found.converged
    assert found.resimulation is not None
    assert found.resimulation.chain_error == math.inf
