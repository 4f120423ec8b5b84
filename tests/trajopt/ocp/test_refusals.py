"""Mistakes in problems, guesses and settings, and the errors that they cause."""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

import casadi as ca
import numpy as np
import pytest

from trajopt import (
    Constraint,
    InfeasibleBoundsError,
    Linkage,
    Mesh,
    Phase,
    Problem,
    continued,
    multi_start,
    solve,
)
from trajopt.ocp import resimulation, textbook
from trajopt.ocp.guesses import Waypoints, straight_lines


def falls(**changes: object) -> Phase:
    settings = {"name": "fall", "states": ("y", "v"), "flow": lambda x, u, p: (x[1], -9.81)}
    return Phase(**(settings | changes))  # type: ignore[arg-type]


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
def test_phases_that_make_no_sense_are_refused(changes: dict, message: str) -> None:
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


# -- functions that cannot be traced --------------------------------------------------------------


@pytest.mark.parametrize(
    ("flow", "message"),
    [
        (lambda x, u, p: None, "flow gives None: end it with return"),
        (lambda x, u, p: "v", "flow gives 'v': must be a real number"),
        (lambda x, u, p: (x[1], "g"), "flow gives 'g': must be a real number"),
        (lambda x, u, p: (x[1], 1j), "flow gives 1j: must be a real number"),
        (lambda x, u, p: (x[1], None), "flow gives None"),
        (lambda x, u, p: x[1] * 1j, "flow cannot be traced.*complex"),
        (lambda x, u, p: (x[5], 0), r"x \(2\), u \(0\), p \(0\).*indices count from 0"),
        (lambda x, u, p: (x[1], u[0]), "indices count from 0"),
        (lambda x, u, p: (x[1], 1 if x[0] > 0 else -1), "casadi.if_else"),
        (lambda x, u, p: (x[1], max(x[0], 0)), "casadi.if_else"),
        (lambda x, u: (x[1], 0), "it is called with these arguments"),
        (lambda x, u, p: tuple(x), "casadi.vertsplit"),
        (lambda x, u, p: (x[1], ca.SX.sym("g")), "only symbols of its own arguments"),
        (lambda x, u, p: ca.SX.zeros(2, 2), r"matrix of shape \(2, 2\)"),
        (lambda x, u, p: (x[1], math.nan), "not finite for any"),
        (lambda x, u, p: x[1], "1 rates for the 2 states"),
        (3.0, "flow = 3.0: must be a function"),
        (None, "flow = None: must be a function"),
    ],
)
def test_flows_that_cannot_be_traced_are_named_with_their_phase(flow: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=f"phase 'fall': .*{message}"):
        Problem((falls(flow=flow),))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cost": lambda x, u, p: x}, "cost gives 2 numbers, not one"),
        ({"powers": lambda x, u, p: ()}, "powers gives no numbers"),
        ({"path": Constraint(lambda x, u, p: x, 0.0, 1.0, ("y",))}, "2 numbers for its 1 names"),
        ({"at_end": Constraint(lambda x, p: None, 0.0, 1.0, ("y",))}, "at_end gives None"),
    ],
)
def test_costs_and_constraints_of_the_wrong_size_are_named(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=f"phase 'fall': .*{message}"):
        Problem((falls(**changes),))


def test_endpoint_costs_and_boundaries_of_the_wrong_size_are_named() -> None:
    with pytest.raises(ValueError, match="endpoint_cost gives 2 numbers, not one: add them up"):
        Problem((falls(),), endpoint_cost=lambda starts, ends, durations, p: ends[0])
    both = Constraint(lambda starts, ends, durations, p: ends[0], 0.0, 1.0, ("y",))
    with pytest.raises(ValueError, match="boundary gives 2 numbers for its 1 names"):
        Problem((falls(),), boundary=both)


# -- kinds and numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"name": 3}, TypeError, "name = 3: must be text"),
        ({"states": (1, 2)}, TypeError, "states = .*give a tuple of names"),
        ({"bounds": [1.0]}, TypeError, "bounds = .*must be a mapping"),
        ({"bounds": {"y": "low"}}, TypeError, "bounds of y = 'low': must be a real number"),
        ({"bounds": {"y": (0.0, 1.0, 2.0)}}, TypeError, "bounds of y = .*lower, upper"),
        ({"bounds": {"y": None}}, TypeError, "bounds of y = None"),
        ({"bounds": {"y": 1j}}, TypeError, "bounds of y = 1j"),
        ({"bounds": {"y": 10**400}}, ValueError, "bounds of y: must be finite"),
        ({"start": {"y": (0.0, math.nan)}}, InfeasibleBoundsError, "start of y.*not NaN"),
        ({"duration": math.nan}, InfeasibleBoundsError, "duration = nan"),
        ({"duration": "long"}, TypeError, "duration = 'long'"),
        ({"floor": math.nan}, ValueError, "floor = nan"),
        ({"path": lambda x, u, p: x}, TypeError, "path = .*must be a Constraint"),
    ],
)
def test_phases_of_the_wrong_kind_are_refused(changes: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=f"(?s)phase.*{message}"):
        falls(**changes)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: Problem(falls()), TypeError, "phases = .*must be a tuple of Phases"),
        (lambda: Problem((falls(),), duration=math.nan), InfeasibleBoundsError, "not NaN"),
        (lambda: Problem((falls(),), parameters={"m": "x"}), TypeError, "bounds of m = 'x'"),
        (lambda: Problem((falls(),), linkages=(3,)), TypeError, "must be a tuple of Linkages"),
        (lambda: Linkage(0, 1, offset={"y": math.nan}), ValueError, "offset of y = nan"),
        (lambda: Linkage(-1, 1), ValueError, "source = -1"),
        (lambda: Linkage(0, 1.5), TypeError, "target = 1.5"),
        (lambda: Constraint(len, 0.0, 1.0, "abc"), TypeError, "names = 'abc': give a tuple"),
        (lambda: Constraint(len, [0.0, 1.0], 1.0, ("a",)), ValueError, "lower = .*1 names"),
        (lambda: Constraint(len, math.nan, 1.0, ("a",)), InfeasibleBoundsError, "not NaN"),
        (lambda: Waypoints(textbook.gear(), points=0), ValueError, "points = 0"),
        (lambda: Mesh.uniform(1, 10, 200), ValueError, "degree = 200: .*at most 40"),
        (lambda: Mesh.uniform(1, 10**9), ValueError, "elements = 1000000000"),
        (lambda: Mesh.uniform(1, 1.5), TypeError, "elements = 1.5"),
        (lambda: Mesh.uniform(10**9), ValueError, "phases.* = 1000000000"),
        (lambda: Mesh(((0.0, math.nan, 1.0),), ((3, 3),)), ValueError, "must increase from 0 to 1"),
        (lambda: Mesh(((0.0, 1.0),), ((3,),), control_degree=0), ValueError, "control_degree = 0"),
    ],
)
def test_parts_of_the_wrong_kind_are_refused(make: Any, error: type, message: str) -> None:
    begin = time.process_time()
    with pytest.raises(error, match=f"(?s){message}"):
        make()
    assert time.process_time() - begin < 2.0


MOVE = textbook.least_effort_move()


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"problem": None}, TypeError, "problem = None: must be a trajopt.Problem"),
        ({"tolerance": math.nan}, ValueError, "tolerance = nan"),
        ({"limit_tolerance": 0.0}, ValueError, "limit_tolerance = 0"),
        ({"passes": -1}, ValueError, "passes = -1"),
        ({"passes": 1.5}, TypeError, "passes = 1.5"),
        ({"verify": "yes"}, TypeError, "verify = 'yes': must be True or False"),
        ({"mesh": 10}, TypeError, "mesh = 10: must be a trajopt.Mesh"),
        ({"guess": 3}, TypeError, "guess = 3"),
        ({"guess": [np.zeros(3)]}, TypeError, "must be a sequence of trajopt.PhaseTrajectory"),
        ({"parameters": [1.0]}, ValueError, r"parameters = \[1.0\]: of shape \(1,\)"),
        ({"parameters": "x"}, TypeError, "parameters = 'x'"),
        ({"option_sets": ()}, ValueError, "give at least one"),
        ({"nonsense": 1}, ValueError, "nonsense = 1: neither a setting .* nor an option of IPOPT"),
        ({"option_sets": ({"nonsense": 1},)}, ValueError, "nonsense = 1"),
        ({"max_iter": "x"}, ValueError, "max_iter = 'x'"),
        ({"max_iter": -3}, ValueError, "max_iter = -3"),
        ({"tol": math.nan}, ValueError, "tol = nan"),
        ({"tol": None}, TypeError, "tol = None"),
        ({"mu_strategy": "wild"}, ValueError, "mu_strategy = 'wild'"),
        ({"linear_solver": "ma27"}, ValueError, "linear_solver"),
    ],
)
def test_solve_refuses_what_makes_no_sense(settings: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=f"(?s){message}"):
        solve(**({"problem": MOVE} | settings))


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"workers": 0}, ValueError, "workers = 0"),
        ({"workers": 1.5}, TypeError, "workers = 1.5"),
        ({"starts": -1}, ValueError, "starts = -1"),
        ({"family": 3}, TypeError, "family = 3: must be a function"),
        ({"family": lambda rng, index: 3}, TypeError, "family: gives 3"),
        ({"progress": "yes"}, TypeError, "progress = 'yes'"),
        ({"nonsense": 1}, ValueError, "nonsense = 1"),
    ],
)
def test_a_search_refuses_what_makes_no_sense(settings: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        multi_start(**({"problem": MOVE, "family": Waypoints(MOVE), "starts": 2} | settings))


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"problem_at": MOVE}, TypeError, "problem_at = "),
        ({"problem_at": lambda value: 3}, TypeError, "problem_at.* = 3: must be a trajopt.Problem"),
        ({"values": [1.0, math.nan]}, ValueError, "values = nan"),
        ({"values": "ab"}, TypeError, "values = 'ab'"),
        ({"step": math.nan}, ValueError, "step = nan"),
        ({"max_jump": -1.0}, ValueError, "max_jump = -1.0"),
        ({"nonsense": 1}, ValueError, "nonsense = 1"),
    ],
)
def test_a_continuation_refuses_what_makes_no_sense(
    settings: dict, error: type, message: str
) -> None:
    sensible = {"problem_at": lambda value: MOVE, "start": straight_lines(MOVE), "values": [1, 2]}
    with pytest.raises(error, match=f"(?s){message}"):
        continued(**(sensible | settings))


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("states", lambda a: a[:, :-1], "states: of shape"),
        ("controls", lambda a: a[0], "controls: of shape"),
        ("edges", lambda a: a[:1], "edges: of shape"),
        ("edges", lambda a: a[::-1], "edges = .*must increase from 0"),
        ("nodes", lambda a: 2 * a, "nodes = .*must end with 1"),
        ("states", lambda a: a.astype(complex), "states = .*real numbers"),
        ("states", lambda a: a.astype(str), "states = .*real numbers"),
        ("states", lambda a: a[..., :1], "1 states and 1 controls"),
    ],
)
def test_guesses_whose_arrays_do_not_fit_are_refused(name: str, change: Any, message: str) -> None:
    (line,) = straight_lines(MOVE)
    with pytest.raises((TypeError, ValueError), match=f"(?s){message}"):
        solve(MOVE, [dataclasses.replace(line, **{name: change(getattr(line, name))})])


@pytest.mark.parametrize("side", ["up", "", None, 1])
def test_sides_of_a_jump_are_left_and_right(side: Any) -> None:
    (line,) = straight_lines(MOVE)
    with pytest.raises(ValueError, match="choose 'left' or 'right'"):
        line.control(0.5, side)
