"""Costates compared with analytic ones; the Hamiltonian of a solution."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from trajopt import Extremal, Linkage, Mesh, Phase, Problem, equal, solve
from trajopt.ocp import textbook

SCHEMES = [("trapezoid", 2e-3), ("hermite-simpson", 1e-6), ("radau", 1e-9)]


def regulator(**more: Any) -> Problem:
    """x' = u at least integral of x^2 + u^2: the price of x is 2 x tanh(time left)."""
    phase = Phase(
        "regulate",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: (u,),
        cost=lambda x, u, p: x**2 + u**2,
        start={"x": 1.0},
        **{"duration": 2.0} | more,
    )
    return Problem((phase,))


def on(scheme: str, problem: Problem, elements: int = 40, degree: int = 4) -> Extremal:
    return solve(problem, mesh=Mesh.uniform(problem, elements, degree, scheme), passes=0)


@pytest.mark.parametrize(("scheme", "error"), SCHEMES)
def test_the_regulators_costate_is_riccatis(scheme: str, error: float) -> None:
    found = on(scheme, regulator())
    t, x = found.phases[0].edges, found.phases[0].state(found.phases[0].edges)[:, 0]
    np.testing.assert_allclose(
        found.certificate.costates[0][:, 0], 2 * x * np.tanh(2.0 - t), atol=error
    )


@pytest.mark.parametrize(("scheme", "error"), SCHEMES)
def test_the_double_integrators_costates_are_straight_lines(scheme: str, error: float) -> None:
    found = on(scheme, textbook.least_effort_move())
    t, costates = found.phases[0].edges, found.certificate.costates[0]
    np.testing.assert_allclose(costates[:, 0], -24.0, rtol=3 * error)
    np.testing.assert_allclose(costates[:, 1], -2 * (6 - 12 * t), atol=24 * error)


def test_the_costate_at_the_start_is_the_derivative_of_the_least_cost() -> None:
    def swing(tilt: float) -> Extremal:
        problem = textbook.cart_pole()
        phase = problem.phases[0]
        start = {**phase.start, "q2": tilt}
        moved = Problem((Phase(**{**vars(phase), "start": start}),))
        return solve(moved, base.phases, base.mesh, passes=0, verify=False, mu_init=1e-6)

    base = solve(textbook.cart_pole())
    slope = (swing(1e-3).cost - swing(-1e-3).cost) / 2e-3
    assert base.certificate.costates[0][0, 1] == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize(
    ("scheme", "degree"), [("trapezoid", 2), ("hermite-simpson", 3), ("radau", 2)]
)
def test_the_hamiltonian_becomes_constant_as_the_mesh_is_refined(scheme: str, degree: int) -> None:
    spreads = [
        on(scheme, regulator(), n, degree).certificate.hamiltonian_spread for n in (5, 10, 20)
    ]
    assert spreads[1] < 0.6 * spreads[0]
    assert spreads[2] < 0.6 * spreads[1]


def test_a_fixed_durations_price_is_the_hamiltonian() -> None:
    """The regulator's least cost over T is tanh T."""
    found = on("radau", regulator())
    price = 1 - math.tanh(2.0) ** 2
    assert found.certificate.duration_price == pytest.approx([price], rel=1e-8)
    assert found.certificate.hamiltonian[0] == pytest.approx(price, abs=1e-8)
    assert found.certificate.transversality_error < 1e-9


@pytest.mark.parametrize("problem", [textbook.brachistochrone(), textbook.fastest_move()])
def test_a_free_duration_has_no_price(problem: Problem) -> None:
    found = solve(problem)
    assert found.certificate.duration_price == pytest.approx([0.0], abs=1e-6)
    assert found.certificate.transversality_error < 1e-5


def test_a_cost_of_the_durations_counts_in_their_price() -> None:
    def timed(how: str) -> Extremal:
        phase = textbook.brachistochrone().phases[0]
        if how == "running":
            return solve(Problem((phase,)))
        free = Phase(**{**vars(phase), "cost": None})
        return solve(Problem((free,), endpoint_cost=lambda s, e, d, p: d[0]))

    running, ending = timed("running"), timed("ending")
    assert ending.cost == pytest.approx(running.cost, rel=1e-9)
    assert ending.certificate.duration_price == pytest.approx([-1.0], abs=1e-6)
    assert ending.certificate.transversality_error < 1e-5


def test_bounded_integrals_count_in_the_hamiltonian() -> None:
    found = solve(textbook.hanging_chain())
    assert found.certificate.hamiltonian_spread < 1e-7
    assert found.certificate.transversality_error < 1e-7


def test_costates_are_passed_on_through_a_linkage_by_its_transposed_jacobian() -> None:
    def kicked(x: Any, p: Any) -> Any:
        return x[0] + 0.1 * x[1], -0.5 * x[1] + ca.sin(x[0])

    def half(name: str, **ends: Any) -> Phase:
        return Phase(
            name,
            states=("x", "v"),
            controls=("u",),
            flow=lambda x, u, p: (x[1], u),
            cost=lambda x, u, p: u**2,
            duration=1.0,
            **ends,
        )

    link = Linkage(0, 1, kicked)
    phases = half("a", start={"x": 0.0, "v": 0.0}), half("b", end={"x": 2.0, "v": 0.0})
    found = solve(Problem(phases, (link,)))
    before, after = found.certificate.costates[0][-1], found.certificate.costates[1][0]
    x = found.phases[0].end
    jacobian = np.array([[1.0, 0.1], [math.cos(x[0]), -0.5]])
    assert before == pytest.approx(jacobian.T @ after, rel=1e-7)


def test_the_costate_at_a_free_end_is_zero() -> None:
    found = on("radau", regulator())
    assert found.certificate.costates[0][-1] == pytest.approx([0.0], abs=1e-9)


def test_the_price_of_a_bounded_integral_is_the_costs_derivative_by_its_bound() -> None:
    def chain(length: float) -> float:
        return solve(textbook.hanging_chain(length)).cost

    slope = (chain(1.501) - chain(1.499)) / 0.002
    exact = (textbook.hanging_chain_energy(1.501) - textbook.hanging_chain_energy(1.499)) / 0.002
    assert slope == pytest.approx(exact, rel=1e-5)
    assert equal(lambda x, u, p: u, [1.0], "slope").names == ("slope",)
