"""Limits between the nodes, powers, integrals, static parameters, costs of ends."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from scripts.studies import textbook
from tests.trajopt.ocp.problems import FREE, move, solve_once, solved
from trajopt import Constraint, Extremal, Mesh, Phase, Problem, equal, nonnegative, solve
from trajopt.ocp.guesses import straight_lines
from trajopt.ocp.schemes import radau_nodes
from trajopt.ocp.solve import tightened
from trajopt.ocp.transcription import Transcription


#: |v| <= 1.2: accelerate parabolically for q = 1/2, cruise, brake: cost 8/3 v^2 / q.
def speed_limited(limit: float) -> float:
    q = 1.5 * (1 - 1 / limit)
    return 8 / 3 * limit**2 / q


@pytest.mark.parametrize(
    ("scheme", "form"),
    [
        ("radau", "path"),
        ("radau", "bound"),
        pytest.param("hermite-simpson", "path", marks=pytest.mark.slow),
    ],
)
def test_limits_hold_between_the_nodes_to_the_tolerance(scheme: str, form: str) -> None:
    limit = 1.2
    phase = move(bounds={"v": (-FREE, limit)})
    if form == "path":
        phase = move(path=nonnegative(lambda x, u, p: limit - x[1], "speed"))
    problem = Problem((phase,))
    found = solve(problem, mesh=Mesh.uniform(problem, 7, scheme=scheme))
    assert found.converged, found.report()
    t = np.linspace(0.0, 1.0, 5001)
    assert found.phases[0].state(t)[:, 1].max() <= limit + 1.5e-6
    assert sum(violation.amount for violation in found.audit) < 1e-6
    assert found.cost == pytest.approx(speed_limited(limit), rel=1e-5)


def test_equations_along_the_path_are_refused_under_radau_and_hold_under_hermite_simpson() -> None:
    steady = equal(lambda x, u, p: (u - 2 * x[1],), [1.0], "feedback")
    problem = Problem((move(end={}, path=steady),))
    with pytest.raises(ValueError, match="'feedback' of phase 'move' is an equation"):
        solve(problem)
    found = solve_once(problem, mesh=Mesh.uniform(problem, 30, scheme="hermite-simpson"))
    assert found.phases[0].end[1] == pytest.approx(0.5 * (math.e**2 - 1), rel=1e-6)


def test_backing_off_moves_limits_inwards_but_never_past_each_other() -> None:
    path = Constraint(
        lambda x, u, p: (u, x[1], x[0]),
        np.array([-1.0, -FREE, 0.3]),
        np.array([1.0, 2.0, 0.3]),
        ("a", "b", "c"),
    )
    problem = Problem((move(path=path, bounds={"v": (-FREE, 5.0), "u": (0.0, 1.0)}),) * 2)
    margins = {"a": 0.1, "b": 0.2, "c": 0.5, "v": 0.1}
    phase, other = tightened(problem, {(0, name): m for name, m in margins.items()}).phases
    assert other.bounds == problem.phases[1].bounds  # of the same name
    tight = phase.path
    assert tight is not None
    assert phase.bounds == {"v": (-FREE, 4.9), "u": (0.0, 1.0)}
    assert tight.lower == pytest.approx([-0.9, -FREE, 0.3])
    assert tight.upper == pytest.approx([0.9, 1.8, 0.3])
    pinched = tightened(problem, {(0, "a"): 3.0}).phases[0].path
    assert pinched is not None
    assert pinched.lower[0] == pinched.upper[0] == 0.0


def test_the_maximum_of_a_power_and_its_floor_is_exact_at_the_nodes() -> None:
    problem = textbook.least_work_move()
    transcription = Transcription(problem, Mesh.uniform(problem, 7, 5))
    result = transcription.solve(straight_lines(problem), tol=1e-10)
    assert result.success
    slacks = transcription.layout.split(result.unknowns)[0, "slacks", 5].ravel(order="F")
    t = result.phases[0]
    times = (t.edges[:-1, None] + np.diff(t.edges)[:, None] * radau_nodes(5)[1:]).ravel()
    power = t.state(times)[:, 1] * t.control(times, "left")[:, 0]
    np.testing.assert_allclose(slacks, np.maximum(power, 0.0), atol=2e-6)


def test_two_powers_are_paid_for_separately() -> None:
    phase = textbook.least_work_move().phases[0]
    # Work against the block, and against the brakes.
    both = dataclasses.replace(phase, powers=lambda x, u, p: (u * x[1], -u * x[1]))
    found = solve_once(Problem((both,)))
    assert found.cost == pytest.approx(2 * textbook.least_work(), rel=5e-3)


def test_a_bounded_integral_binds() -> None:
    """Impulses of 1 N s at least: the mean of u is 1, u is constant, and v ends at 1 m/s."""
    impulse = Constraint(lambda x, u, p: u, np.array([1.0]), np.array([FREE]), ("impulse",))
    problem = Problem((move(start={"x": 0.0, "v": 0.0}, end={}, integral=impulse),))
    found = solve_once(problem)
    assert found.cost == pytest.approx(1.0, rel=1e-8)
    assert found.phases[0].end == pytest.approx([0.5, 1.0], abs=1e-7)


@pytest.mark.parametrize("scheme", ["radau", "hermite-simpson", "trapezoid"])
def test_costs_of_running_and_of_the_end_are_added(scheme: str) -> None:
    """x' = u: 10 (x(1) - 1)^2 + integral of u^2 is least at x(1) = 10/11."""
    glide = Phase(
        "glide",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: (u,),
        cost=lambda x, u, p: u**2,
        start={"x": 0.0},
        duration=1.0,
    )
    problem = Problem((glide,), endpoint_cost=lambda s, e, d, p: 10 * (e[0] - 1) ** 2)
    found = solve_once(problem, mesh=Mesh.uniform(problem, 3, scheme=scheme))
    assert found.cost == pytest.approx(10 / 11, rel=1e-9)
    assert found.phases[0].end == pytest.approx([10 / 11], rel=1e-9)


def test_start_and_end_constraints_bind_on_functions_of_the_state() -> None:
    ring = equal(lambda x, p: x[0] ** 2 + x[1] ** 2, [1.0], "on the ring")
    ahead = nonnegative(lambda x, p: x[0] - 2 * x[1] + 0.1, "ahead")
    found = solve_once(Problem((move(start={}, end={"x": 3.0}, at_start=ring, at_end=ahead),)))
    start, end = found.phases[0].start, found.phases[0].end
    assert start @ start == pytest.approx(1.0, abs=1e-8)
    assert end[0] - 2 * end[1] + 0.1 >= -1e-8


def test_a_parameter_held_fixed_costs_what_its_value_implies() -> None:
    free = textbook.gear()
    for ratio in (2.0, 9.0):
        found = solve_once(dataclasses.replace(free, parameters={"ratio": ratio}))
        assert found.parameters == pytest.approx([ratio])
        assert found.cost == pytest.approx(12 * (0.02 * ratio + 0.5 / ratio) ** 2, rel=1e-8)
    assert found.cost > solved("gear").cost


def test_a_guess_of_the_parameters_is_taken() -> None:
    problem = textbook.gear()
    transcription = Transcription(problem, Mesh.uniform(problem))
    guess = straight_lines(problem)
    assert transcription.solve(guess, max_iter=0).parameters == pytest.approx([50.05])
    near = transcription.solve(guess, parameters=np.array([5.5]), max_iter=0)
    assert near.parameters == pytest.approx([5.5])


def test_the_total_duration_is_shared_by_the_phases() -> None:
    problem = dataclasses.replace(textbook.bouncing_ball(), duration=2.0)
    found = solve_once(problem)
    assert found.duration == pytest.approx(2.0, abs=1e-9)
    assert found.cost > textbook.bouncing_ball_energy()


@cache
def weaker_when_fast() -> Extremal:
    """A move by a motor that is weaker the faster it turns."""

    def margins(x: Any, u: Any, p: Any) -> Any:
        return 7.0 - 4.0 * x[1] - u, 8.0 + u

    problem = Problem((move(path=nonnegative(margins, "motor", "brake")),))
    return solve(problem, tolerance=1e-6)


@pytest.mark.parametrize(("scheme", "error"), [("hermite-simpson", 1e-3), ("trapezoid", 3e-2)])
def test_a_path_constraint_on_control_and_state_together_binds_at_every_scheme(
    scheme: str, error: float
) -> None:
    best = weaker_when_fast()
    problem = best.problem
    assert 7 - 4 * best.state(0.43)[1] - best.control(0.43)[0] > -1e-5
    assert best.cost > 12.01
    other = solve(problem, mesh=Mesh.uniform(problem, 16, scheme=scheme), passes=0, verify=False)
    assert other.cost == pytest.approx(best.cost, rel=error)


@pytest.mark.parametrize(("floor", "least"), [(-FREE, -1e-6), (0.5, 0.6)])
def test_a_floor_says_which_powers_count(floor: float, least: float) -> None:
    """Without a floor, braking returns all; with 0.5 W, at least that is drawn all the time."""
    phase = dataclasses.replace(textbook.least_work_move().phases[0], floor=floor)
    found = solve_once(Problem((phase,)))
    assert least < found.transcribed_cost < least + 0.4


@pytest.mark.slow
@pytest.mark.parametrize("elements", [10, 30])
def test_a_bound_on_a_state_holds_to_the_tolerance_where_the_arc_is_left(elements: int) -> None:
    """Van der Pol's oscillator brought to rest while its rate is bounded; least cost 1.6208844."""
    oscillator = Phase(
        "oscillator",
        states=("x", "v"),
        controls=("u",),
        flow=lambda x, u, p: (x[1], -x[0] + x[1] * (1 - x[0] ** 2) + u),
        cost=lambda x, u, p: x[0] ** 2 + x[1] ** 2,
        bounds={"u": (-1.0, 1.0), "v": (-0.25, FREE)},
        start={"x": 1.0, "v": 0.0},
        duration=5.0,
    )
    found = solve(Problem((oscillator,)), mesh=Mesh.uniform(1, elements))
    assert found.converged, found.report()
    assert found.cost == pytest.approx(1.6208844, rel=1e-5)
