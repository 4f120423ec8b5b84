"""The schemes' matrices, and the order at which each converges on problems with known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trajopt import Mesh, Phase, Problem
from trajopt.ocp.guesses import straight_lines
from trajopt.ocp.schemes import (
    bernstein_matrix,
    differentiation_matrix,
    hermite_simpson,
    lagrange_matrix,
    quadrature_weights,
    radau,
    radau_nodes,
    trapezoid,
)
from trajopt.ocp.transcription import Result, Transcription

#: (scheme, degree, elements): errors there are far above rounding.
CASES = [
    ("trapezoid", 2, (16, 32, 64)),
    ("hermite-simpson", 3, (8, 16, 32)),
    ("radau", 2, (8, 16, 32)),
    ("radau", 3, (4, 8, 16)),
    ("radau", 4, (3, 6, 12)),
    ("radau", 5, (2, 4, 6)),
]


OSCILLATOR = Problem(
    (
        Phase(
            "swing",
            states=("x", "v"),
            flow=lambda x, u, p: (x[1], -x[0]),
            start={"x": 1.0, "v": 0.0},
            duration=4.0,
        ),
    )
)


#: x' = u from 1 at least integral of x^2 + u^2 over 2 s, which is tanh 2 (Riccati).
REGULATOR = Problem(
    (
        Phase(
            "regulate",
            states=("x",),
            controls=("u",),
            flow=lambda x, u, p: (u,),
            cost=lambda x, u, p: x**2 + u**2,
            start={"x": 1.0},
            duration=2.0,
        ),
    )
)


def transcribed(problem: Problem, scheme: str, degree: int, elements: int) -> Result:
    transcription = Transcription(problem, Mesh.uniform(problem, elements, degree, scheme))
    guess = straight_lines(problem)
    result = transcription.solve(guess, tol=1e-13, constr_viol_tol=1e-13)
    assert result.success
    return result


def observed_orders(errors: list[float], elements: tuple[int, ...]) -> np.ndarray:
    return -np.diff(np.log(errors)) / np.diff(np.log(elements))


def theoretical_order(scheme: str, degree: int) -> int:
    return Mesh.uniform(1, 1, degree, scheme).scheme_of_degree(degree).order


@pytest.mark.parametrize(("scheme", "degree", "elements"), CASES)
def test_states_at_edges_converge_at_the_order_of_the_scheme(
    scheme: str, degree: int, elements: tuple[int, ...]
) -> None:
    exact = [math.cos(4.0), -math.sin(4.0)]
    results = [transcribed(OSCILLATOR, scheme, degree, n) for n in elements]
    errors = [float(np.abs(r.phases[0].end - exact).max()) for r in results]
    order = theoretical_order(scheme, degree)
    assert observed_orders(errors, elements) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize(("scheme", "degree", "elements"), CASES)
def test_the_least_cost_converges_at_the_order_of_the_scheme(
    scheme: str, degree: int, elements: tuple[int, ...]
) -> None:
    results = [transcribed(REGULATOR, scheme, degree, n) for n in elements]
    errors = [abs(r.cost - math.tanh(2.0)) for r in results]
    order = theoretical_order(scheme, degree)
    assert observed_orders(errors, elements) == pytest.approx(order, abs=0.2)


def test_the_orders_are_those_of_the_literature() -> None:
    assert trapezoid().order == 2
    assert hermite_simpson().order == 4
    assert [radau(d).order for d in (1, 2, 3, 4, 5)] == [1, 3, 5, 7, 9]


@pytest.mark.parametrize("degree", [1, 3, 6, 12])
def test_the_matrices_are_exact_for_polynomials_of_their_degree(degree: int) -> None:
    nodes = radau_nodes(degree)
    p = np.polynomial.Polynomial(np.arange(1.0, degree + 2) / (degree + 1))
    np.testing.assert_allclose(
        differentiation_matrix(degree) @ p(nodes), p.deriv()(nodes[1:]), rtol=1e-10
    )
    s = np.linspace(0, 1, 7)
    np.testing.assert_allclose(lagrange_matrix(nodes, s) @ p(nodes), p(s), rtol=1e-10)
    q = np.polynomial.Polynomial(np.ones(2 * degree - 1))
    assert quadrature_weights(degree) @ q(nodes[1:]) == pytest.approx(q.integ()(1.0))


@pytest.mark.parametrize(
    "scheme", [trapezoid(), hermite_simpson(), *(radau(d) for d in (1, 2, 5))], ids=str
)
def test_a_schemes_parts_agree_with_each_other(scheme: object) -> None:
    s = scheme
    assert s.quadrature.sum() == pytest.approx(1.0)  # type: ignore[attr-defined]
    nodes, h = s.nodes, 0.3  # type: ignore[attr-defined]
    np.testing.assert_allclose(s.D @ (1 + h * nodes), h * s.A.sum(axis=1), atol=1e-14)  # type: ignore[attr-defined]
    np.testing.assert_allclose(s.growth(np.array([0.0, 1.0])).sum(axis=1), [0, 1], atol=1e-14)  # type: ignore[attr-defined]


def test_bezier_controls_stay_within_the_hull_of_their_coefficients() -> None:
    basis = bernstein_matrix(3, np.linspace(0, 1, 50))
    assert basis.min() >= 0
    np.testing.assert_allclose(basis.sum(axis=1), 1)


def test_a_cap_on_the_controls_degree_makes_it_linear_and_costs_more() -> None:
    capped = Mesh.uniform(REGULATOR, 2, 5, control_degree=1)
    guess = straight_lines(REGULATOR)
    result = Transcription(REGULATOR, capped).solve(guess)
    assert result.phases[0].controls.shape == (2, 2, 1)
    best = transcribed(REGULATOR, "radau", 5, 2).cost
    assert best + 1e-5 < result.cost < best * 1.01
