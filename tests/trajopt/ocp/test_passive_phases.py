"""Phases without controls."""

from __future__ import annotations

import pytest

from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.solve import solve


@pytest.mark.parametrize("scheme", ["radau", "trapezoid", "hermite-simpson"])
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
