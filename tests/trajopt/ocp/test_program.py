"""The nonlinear program: its derivatives, its rows, its unknowns."""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
import numpy as np
import pytest

from trajopt import Constraint, Linkage, Mesh, Phase, Problem
from trajopt.ocp.guesses import straight_lines
from trajopt.ocp.layout import pack, unpack
from trajopt.ocp.transcription import Transcription


def everything() -> Problem:
    """Two phases that have all that phases can have."""

    def pushed(x: Any, u: Any, p: Any) -> Any:
        return x[1] * p[0], ca.sin(x[0]) + u[0] * u[1], x[0] * x[2] + u[1]

    def limited(x: Any, u: Any, p: Any) -> Any:
        return x[0] * u[0] + p[1], ca.exp(x[1]) * u[1] ** 2

    first = Phase(
        "first",
        states=("a", "b", "c"),
        controls=("u", "w"),
        flow=pushed,
        cost=lambda x, u, p: u[0] ** 2 + x[0] ** 2 * u[1] + p[0] * x[2],
        powers=lambda x, u, p: (u[0] * x[1] * p[1], u[1] * x[2]),
        path=Constraint(limited, np.zeros(2), np.ones(2), ("one", "other")),
        integral=Constraint(lambda x, u, p: x[0] * u[0] * p[0], np.zeros(1), np.ones(1), ("sum",)),
        at_start=Constraint(lambda x, p: x[0] * x[1] + p[0], np.zeros(1), np.ones(1), ("s",)),
        at_end=Constraint(lambda x, p: ca.sin(x[2]) * p[1], np.zeros(1), np.ones(1), ("e",)),
    )
    second = Phase("second", states=("y",), flow=lambda x, u, p: (ca.cos(x) * p[1],))
    return Problem(
        (first, second),
        linkages=(Linkage(0, 1, lambda x, p: x[0] * x[1] * p[0]), Linkage(1, 1)),
        parameters={"mass": (0.5, 2.0), "length": (0.1, 1.0)},
        boundary=Constraint(
            lambda starts, ends, durations, p: starts[0][0] * ends[1] * durations[0] * p[0],
            np.zeros(1),
            np.ones(1),
            ("b",),
        ),
        endpoint_cost=lambda starts, ends, durations, p: ends[0][1] ** 3 * durations[1] * p[1],
    )


MESHES = {
    "trapezoid": Mesh.uniform(2, [3, 2], scheme="trapezoid"),
    "hermite-simpson": Mesh.uniform(2, [3, 2], scheme="hermite-simpson"),
    "radau": Mesh(((0.0, 0.2, 0.7, 1.0), (0.0, 0.4, 1.0)), ((2, 4, 2), (3, 1))),
}


@pytest.fixture(params=MESHES)
def transcription(request: pytest.FixtureRequest) -> Transcription:
    return Transcription(everything(), MESHES[request.param])


def test_derivatives_are_those_that_casadi_finds_for_the_whole_program(
    transcription: Transcription,
) -> None:
    program, given = transcription.program.symbols, transcription.program.derivatives
    x, f, g = program["x"], program["f"], program["g"]
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    lagrangian = lam_f * f + ca.dot(lam_g, g)
    whole = ca.Function(
        "whole",
        [x, lam_f, lam_g],
        [ca.gradient(f, x), ca.jacobian(g, x), ca.triu(ca.hessian(lagrangian, x)[0]), f, g],
    )
    rng = np.random.default_rng(1)
    w, weight, mu = rng.uniform(0.5, 1.5, x.numel()), 0.7, rng.normal(size=g.numel())
    expected = whole(w, weight, mu)
    f_value, gradient = given["grad_f"](w, [])
    g_value, jacobian = given["jac_g"](w, [])
    hessian = given["hess_lag"](w, [], weight, mu)
    for ours, theirs in zip((gradient, jacobian, hessian, f_value, g_value), expected, strict=True):
        np.testing.assert_allclose(np.asarray(ours), np.asarray(theirs), rtol=1e-12, atol=1e-12)


def test_the_jacobian_stores_no_zeros_between_elements(transcription: Transcription) -> None:
    jacobian = transcription.program.derivatives["jac_g"].sparsity_out(1)
    assert jacobian.nnz() < 0.4 * jacobian.numel()


def test_unknowns_and_trajectories_are_translated_there_and_back(
    transcription: Transcription,
) -> None:
    problem, layout = transcription.problem, transcription.layout
    p = np.array([1.2, 0.4])
    w = pack(layout, problem, straight_lines(problem), p)
    assert w.shape == (layout.size,)
    parts = layout.split(w)
    assert layout.join(parts) == pytest.approx(w)
    edges = unpack(layout, w)[0].states[:, 0]
    again = unpack(layout, pack(layout, problem, unpack(layout, w), p))[0]
    assert again.states[:, 0] == pytest.approx(edges, abs=1e-12)


def test_every_row_is_named(transcription: Transcription) -> None:
    equations, count = transcription.equations, transcription.program.symbols["g"].numel()
    kinds = {rows.kind for rows in equations.rows}
    assert kinds == {
        *("differential equation", "path constraint", "slack", "integral", "boundary"),
        *("start constraint", "end constraint", "linkage", "total duration"),
    }
    assert equations.count == sum(rows.count for rows in equations.rows) == count
    lower, upper = equations.bounds(transcription.problem)
    assert len(lower) == len(upper) == count


def test_one_transcription_serves_problems_that_differ_in_numbers() -> None:
    problem = everything()
    transcription = Transcription(problem, MESHES["radau"])
    other = dataclasses.replace(problem, duration=3.0, parameters={"mass": 1.0, "length": 0.5})
    result = transcription.solve(straight_lines(other), other, max_iter=0)
    assert result.parameters == pytest.approx([1.0, 0.5])
    different = dataclasses.replace(problem, endpoint_cost=None)
    with pytest.raises(ValueError, match="more than numbers"):
        transcription.solve(straight_lines(problem), different)
