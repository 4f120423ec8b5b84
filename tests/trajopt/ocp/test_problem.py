"""Mistakes in problems, meshes, guesses and settings are refused by name, value and remedy."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from scripts.studies import textbook
from trajopt import (
    Constraint,
    InfeasibleBoundsError,
    Linkage,
    Mesh,
    Phase,
    PhaseTrajectory,
    Problem,
    continued,
    multi_start,
    solve,
)
from trajopt.ocp.guesses import Waypoints, straight_lines
from trajopt.ocp.transcription import Transcription

MOVE = textbook.least_effort_move()
GUESS = straight_lines(MOVE)


def fall(**changes: Any) -> Phase:
    settings = {"name": "fall", "states": ("y", "v"), "flow": lambda x, u, p: (x[1], -9.81)}
    return Phase(**(settings | changes))


def moved(**changes: Any) -> list[PhaseTrajectory]:
    """The straight line with changed arrays."""
    arrays = {name: change(getattr(GUESS[0], name)) for name, change in changes.items()}
    return [dataclasses.replace(GUESS[0], **arrays)]


PHASES = [
    ({"states": ("y", "y")}, ValueError, "everything differently"),
    ({"bounds": {"y": (0.0, 1.0, 2.0)}}, TypeError, "bounds of y = .*lower, upper"),
    ({"bounds": {"w": 1.0}}, ValueError, r"bounds names \['w'\], which are not among"),
    ({"start": {"y": 2.0}, "bounds": {"y": (0.0, 1.0)}}, InfeasibleBoundsError, "y is 2.0 at the"),
    ({"duration": (2.0, 1.0)}, InfeasibleBoundsError, "duration = .* must be positive, lower"),
]


@pytest.mark.parametrize(("changes", "error", "message"), PHASES)
def test_phases_that_make_no_sense_are_refused(changes: Any, error: type, message: str) -> None:
    with pytest.raises(error, match=f"(?s)phase.*{message}"):
        fall(**changes)


def test_an_end_may_lie_outside_the_bounds_by_rounding() -> None:
    fall(start={"y": -1e-17}, bounds={"y": (0.0, math.inf)})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"flow": lambda x, u, p: (x[5], 0)}, r"sizes \(2, 0, 0\).*out of bounds"),
        ({"flow": lambda x, u, p: (x[1], math.sin(x[0]))}, "use CasADi's functions"),
        ({"flow": lambda x, u, p: x[1]}, "1 numbers for its 2 names"),
        ({"path": Constraint(lambda x, u, p: x, 0.0, 1.0, ("y",))}, "2 numbers for its 1 names"),
    ],
)
def test_functions_that_cannot_be_traced_are_named_with_their_phase(
    changes: Any, message: str
) -> None:
    with pytest.raises((TypeError, ValueError), match=f"(?s)phase 'fall': .*{message}"):
        Problem((fall(**changes),))


def test_a_function_that_is_not_finite_everywhere_is_traced() -> None:
    Problem((fall(flow=lambda x, u, p: (x[1], ca.sqrt(x[0]))),))


OTHERS = [
    (lambda: Problem((fall(duration=1.0),), duration=3.0), InfeasibleBoundsError, "1 to 1 s"),
    (lambda: Problem((fall(),), (Linkage(0, 2),)), ValueError, "target = 2: there are 1 phases"),
    (lambda: Problem((fall(),), (Linkage(0, 0, offset={"z": 1.0}),)), ValueError, "offset names"),
    (lambda: Constraint(len, [0.0, 1.0], 1.0, ("a",)), ValueError, "lower = .*1 names"),  # type: ignore[arg-type]
    (lambda: Mesh.uniform(1, 10, 200), ValueError, "degrees = 200: .*at most 40"),
    (lambda: Mesh(((0.0, math.nan, 1.0),), ((3, 3),)), ValueError, "must increase from 0 to 1"),
    (lambda: Transcription(textbook.bouncing_ball(), Mesh.uniform(1)), ValueError, "1 phases, the"),
    (lambda: GUESS[0].control(0.5, "up"), ValueError, "choose 'left' or 'right'"),
]


@pytest.mark.parametrize(("make", "error", "message"), OTHERS)
def test_other_parts_that_make_no_sense_are_refused(make: Any, error: type, message: str) -> None:
    with pytest.raises(error, match=f"(?s){message}"):
        make()


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"problem": None}, TypeError, "problem = None: must be a trajopt.Problem"),
        ({"tolerance": math.nan}, ValueError, "tolerance = nan"),
        ({"guess": []}, ValueError, "0 trajectories for the 1 phases"),
        ({"parameters": [1.0]}, ValueError, r"parameters = \[1.\]: give one number each"),
        ({"nonsense": 1}, ValueError, "No such IPOPT option: nonsense"),
        ({"linear_solver": "ma27"}, ValueError, "linear_solver"),
    ],
)
def test_solve_refuses_what_makes_no_sense(settings: Any, error: type, message: str) -> None:
    with pytest.raises(error, match=f"(?s){message}"):
        solve(**({"problem": MOVE} | settings))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"states": lambda a: a[:, :-1]}, "states: of shape"),
        ({"edges": lambda a: a[::-1]}, "edges = .*must increase from 0"),
        ({"states": lambda a: a * np.nan}, "must all be finite"),
        ({"states": lambda a: a[..., :1]}, "1 states and 1 controls"),
    ],
)
def test_guesses_that_do_not_fit_are_refused(changes: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=f"(?s){message}"):
        solve(MOVE, moved(**changes))


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"family": 3}, TypeError, "family = 3: must be a function"),
    ],
)
def test_a_search_refuses_what_makes_no_sense(settings: Any, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        multi_start(**({"problem": MOVE, "family": Waypoints(MOVE), "starts": 2} | settings))


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"values": [1.0, math.nan]}, ValueError, "values = nan"),
        ({"values": [1.0, 1.0]}, ValueError, "a start and a goal"),
    ],
)
def test_a_continuation_refuses_what_makes_no_sense(
    settings: Any, error: type, message: str
) -> None:
    sensible = {"problem_at": lambda value: MOVE, "start": GUESS, "values": [1, 2]}
    with pytest.raises(error, match=f"(?s){message}"):
        continued(**(sensible | settings))
