"""The passive wheel's cycle, by every scheme, against its closed form."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from trajopt import Mesh, solve
from trajopt.gaits.problem import passive_wheel, passive_wheel_rate


@pytest.mark.parametrize(("legs", "slope"), [(6, 0.25), (8, 0.12), (10, 0.06)])
def test_the_cycle_is_found_whatever_the_number_of_legs(legs: int, slope: float) -> None:
    found = solve(passive_wheel(legs, slope))
    assert found.converged, found.report()
    assert found.cost == pytest.approx(passive_wheel_rate(legs, slope), rel=1e-7)
    assert found.transcribed_cost == pytest.approx(passive_wheel_rate(legs, slope), rel=1e-7)


@pytest.mark.parametrize(
    ("scheme", "tolerance", "accuracy"),
    [("hermite-simpson", 1e-7, 2e-5), ("trapezoid", 1e-5, 3e-3)],
)
def test_other_schemes_find_the_cycle_as_accurately_as_their_order_allows(
    scheme: str, tolerance: float, accuracy: float
) -> None:
    problem = passive_wheel()
    found = solve(problem, mesh=Mesh.uniform(problem, 10, scheme=scheme), tolerance=tolerance)
    assert found.attempts[-1].succeeded
    assert found.cost == pytest.approx(passive_wheel_rate(), rel=accuracy)


def test_a_smooth_motion_is_refined_by_degree_alone() -> None:
    problem = passive_wheel()
    found = solve(problem, mesh=Mesh.uniform(problem, 4, 3))
    assert found.converged
    assert found.mesh.elements == 4
    assert max(found.mesh.degrees[0]) > 3


def test_the_touchdown_is_that_of_the_model() -> None:
    problem = passive_wheel()
    found = solve(problem)
    touchdown = problem.linkages[0].map
    assert isinstance(touchdown, ca.Function)
    after = np.asarray(touchdown(found.phases[0].end, [])).ravel()
    assert after == pytest.approx(found.phases[0].start, abs=1e-9)
