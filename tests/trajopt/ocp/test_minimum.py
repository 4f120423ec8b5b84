"""A cost without a minimum, and a stationary point that is none, do not pass for a solution."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import pytest

from trajopt.ocp.guesses import Waypoints
from trajopt.ocp.multi_start import multi_start
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.solve import solve


def drift(cost: Any, **changes: Any) -> Problem:
    """x' = u from x = 0, for 1 s."""
    settings = {"start": {"x": 0.0}, "duration": 1.0, "cost": cost} | changes
    return Problem((Phase("drift", ("x",), lambda x, u, p: u, ("u",), **settings),))


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(drift(lambda x, u, p: u), marks=pytest.mark.slow),
        drift(lambda x, u, p: -(u**2)),
        drift(lambda x, u, p: -ca.exp(x)),
        pytest.param(drift(lambda x, u, p: -ca.log(1 + (x - 1) ** 2)), marks=pytest.mark.slow),
        drift(lambda x, u, p: -1.0, duration=(0.1, math.inf)),
        drift(None, powers=lambda x, u, p: u, floor=-math.inf),
    ],
    ids=["linear", "a maximum", "exponential", "logarithmic", "duration", "powers"],
)
def test_a_cost_without_a_minimum_is_no_success_and_says_what_grows(problem: Problem) -> None:
    found = solve(problem)
    assert not found.converged
    assert "no minimum" in found.failures[0]
    assert "drift" in found.failures[0]


def test_a_static_parameter_that_grows_is_named() -> None:
    free = Phase("drift", ("x",), lambda x, u, p: u, ("u",), cost=lambda x, u, p: u**2 + p[0])
    found = solve(Problem((free,), parameters={"bonus": (-math.inf, math.inf)}, duration=1.0))
    assert "parameter bonus" in found.failures[0]


def valley(**bounds: Any) -> Problem:
    """From (0, 0) to (1, 0) along a ridge that pays for leaving it, to either side alike."""
    ridge = Phase(
        "ridge",
        states=("x", "y"),
        flow=lambda x, u, p: u,
        controls=("u", "v"),
        cost=lambda x, u, p: ca.sumsqr(u) - 100 * x[1] ** 2,
        start={"x": 0.0, "y": 0.0},
        end={"x": 1.0, "y": 0.0},
        bounds=bounds,
        duration=1.0,
    )
    return Problem((ridge,))


def test_a_guess_on_a_saddle_leads_away_from_it() -> None:
    found = solve(valley(y=(-1.0, 1.0)))
    assert found.cost < -60.0  # the ridge itself costs 1
    assert abs(found.phases[0].state(0.5)[0, 1]) == pytest.approx(1.0, abs=1e-3)


def test_a_search_does_not_count_a_saddle_as_an_optimum() -> None:
    problem = valley()
    search = multi_start(problem, Waypoints(problem), 2)
    assert not search.optima
    assert all("Diverging" in outcome.failure for outcome in search.failures)
