from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import pytest
from trajopt.radau import Transcription
from trajopt.search import polyline
from trajopt.transcription import Mesh

from trajopt.mesh import assess, refined
from trajopt.problem import Constraint, Phase, Problem
from trajopt.schemes.polynomials import (
    bernstein_matrix,
    differentiation_matrix,
    lagrange_matrix,
    quadrature_weights,
    radau_nodes,
)
from trajopt.trajectory import PhaseTrajectory

FREE = np.inf


def pinned_phase(flow, start, end, *, control_limit=FREE, state_limit=None):
    """A phase from `start` to `end` (None: free) of least integral of u squared."""
    n = len(start)
    x, u = ca.SX.sym("x", n), ca.SX.sym("u")
    limit = np.full(n, FREE) if state_limit is None else np.array(state_limit)
    goal = (-limit, limit) if end is None else (np.array(end), np.array(end))
    nothing = np.array([FREE])
    return Phase(
        flow=ca.Function("flow", [x, u], [flow(x, u)]),
        power=ca.Function("power", [x, u], [u**2]),
        path=Constraint(ca.Function("path", [x, u], [u]), -nothing, nothing, ("nothing",)),
        end=Constraint(ca.Function("end", [x], [x[0]]), -nothing, nothing, ("nothing",)),
        state_bounds=(-limit, limit),
        start_bounds=(np.array(start), np.array(start)),
        end_bounds=goal,
        control_bounds=(np.array([-control_limit]), np.array([control_limit])),
    )


def oscillator_error(elements, degree):
    def flow(x, u):
        return ca.vertcat(x[1], -x[0] + 0 * u)

    problem = Problem((pinned_phase(flow, [1.0, 0.0], None),), (), 4.0)
    guess = polyline(np.linspace(0, 4, 5), np.zeros((5, 2)))
    mesh = Mesh.uniform(1, elements, degree)
    result = Transcription(problem, mesh).solve([guess], tol=1e-13, constr_viol_tol=1e-13)
    return np.abs(result.phases[0].end - [np.cos(4.0), -np.sin(4.0)]).max()


@pytest.mark.parametrize("degree", [2, 3])
def test_radau_collocation_converges_at_order_two_degree_minus_one(degree):
    coarse, fine = oscillator_error(6, degree), oscillator_error(12, degree)
    assert np.log2(coarse / fine) == pytest.approx(2 * degree - 1, abs=0.35)


@pytest.mark.parametrize("degree", [1, 3, 6])
def test_the_matrices_are_exact_for_polynomials_of_their_degree(degree):
    nodes = radau_nodes(degree)
    p = np.polynomial.Polynomial(np.arange(1.0, degree + 2))
    assert np.allclose(differentiation_matrix(degree) @ p(nodes), p.deriv()(nodes[1:]))
    s = np.linspace(0, 1, 7)
    assert np.allclose(lagrange_matrix(nodes, s) @ p(nodes), p(s))
    q = np.polynomial.Polynomial(np.ones(2 * degree - 1))
    assert quadrature_weights(degree) @ q(nodes[1:]) == pytest.approx(q.integ()(1.0))


def test_bezier_controls_stay_within_the_hull_of_their_coefficients():
    basis = bernstein_matrix(3, np.linspace(0, 1, 50))
    assert basis.min() >= 0
    assert np.allclose(basis.sum(axis=1), 1)


def test_kellys_cart_pole_costs_what_every_other_tool_finds():
    m1, m2, length, g = 1.0, 0.3, 0.5, 9.81

    def flow(x, u):
        s, c = ca.sin(x[1]), ca.cos(x[1])
        d = m1 + m2 * s**2
        push = length * m2 * s * x[3] ** 2 + u
        cart = (push + m2 * g * c * s) / d
        pole = -(push * c + (m1 + m2) * g * s) / (length * d)
        return ca.vertcat(x[2], x[3], cart, pole)

    phase = pinned_phase(
        flow,
        [0.0, 0.0, 0.0, 0.0],
        [1.0, np.pi, 0.0, 0.0],
        control_limit=20.0,
        state_limit=[2.0, FREE, FREE, FREE],
    )
    t = np.array([0.0, 2.0])
    guess = polyline(t, np.array([[0, 0, 0, 0], [1, np.pi, 0, 0.0]]))
    result = Transcription(Problem((phase,), (), 2.0), Mesh.uniform(1, 16, 5)).solve([guess])
    assert result.success
    assert result.cost == pytest.approx(58.81, abs=0.02)


def test_refinement_splits_only_the_elements_that_miss_the_tolerance():
    def flow(x, u):
        return ca.vertcat(x[1], -x[0] + 0 * u)

    phase = pinned_phase(flow, [1.0, 0.0], None)
    t = np.linspace(0, 1, 5)
    exact = np.stack([np.cos(t), -np.sin(t)], axis=1)
    nodes = np.linspace(0, 1, 6)
    fine = [np.cos(t[0] + 0.25 * nodes), -np.sin(t[0] + 0.25 * nodes)]
    states = np.stack(
        [lagrange_matrix(np.array([0.0, 1.0]), nodes) @ exact[i : i + 2] for i in range(4)]
    )
    states[0] = np.stack(fine, axis=1)
    trajectory = PhaseTrajectory(t, nodes, states, np.array([0.0, 1.0]), np.zeros((4, 2, 1)))
    mesh = Mesh((tuple(t),), 5, 1)
    split = refined(mesh, [assess(phase, trajectory)], 1e-4, 1e-4)
    assert split.fractions[0] == (0.0, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)


def test_a_solved_phase_does_not_depend_on_the_mesh_of_its_guess():
    def flow(x, u):
        return ca.vertcat(x[1], u)

    phase = pinned_phase(flow, [0.0, 0.0], [1.0, 0.0])
    transcription = Transcription(Problem((phase,), (), 1.0), Mesh.uniform(1, 4, 4))
    costs = []
    for n in (2, 9):
        t = np.linspace(0, 1, n)
        costs.append(transcription.solve([polyline(t, np.zeros((n, 2)))]).cost)
    assert costs[0] == pytest.approx(12.0, rel=1e-8)  # u = 6 - 12 t
    assert costs[1] == pytest.approx(12.0, rel=1e-8)


def test_a_floor_counts_only_power_that_is_drawn():
    def flow(x, u):
        return ca.vertcat(x[1], u)

    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    phase = dataclasses.replace(
        pinned_phase(flow, [0.0, 0.0], [1.0, 0.0], control_limit=10.0),
        power=ca.Function("power", [x, u], [u * x[1]]),
    )
    t = np.linspace(0, 1, 5)
    guess = polyline(t, np.stack([t, 0 * t + 1], axis=1))
    costs = [
        Transcription(Problem((p,), (), 1.0), Mesh.uniform(1, 12, 5)).solve([guess]).cost
        for p in (phase, dataclasses.replace(phase, floor=-np.inf))
    ]
    assert costs[0] > 0.4  # speeding up costs its kinetic energy
    assert costs[1] == pytest.approx(0.0, abs=1e-6)  # which braking gives back
