"""Collocation schemes, the names by which a mesh asks for them, and their polynomials.

A new scheme is a function that returns a `Scheme`, and its entry in `SCHEMES`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import comb, roots_jacobi

from trajopt.ocp.arrays import Array, Indices


@dataclasses.dataclass(frozen=True, eq=False)
class Scheme:
    """D X = h A F on an element of length h, with F = flow at the nodes.

    Between the nodes, the state is the integral of the polynomial through the rates at the nodes
    that A uses. The control is another polynomial.
    """

    nodes: Array  # where states are unknowns, in [0, 1], the first 0 and the last 1, shape (n,)
    D: Array  # shape (r, n); r rows of defects per state
    A: Array  # shape (r, n); the flow is not used at nodes whose column is zero
    quadrature: Array  # weights of the nodes for integrals over [0, 1], shape (n,)
    control_nodes: Array  # m nodes of the control polynomial, in [0, 1]
    control_basis: Array  # control at `nodes` from its m coefficients, shape (n, m)
    control_values: Array  # control at `control_nodes` from its coefficients, shape (m, m)
    # whether neighbours share the coefficients at their common edge, so that the control is
    # continuous; otherwise it may jump there
    shared_controls: bool
    order: int  # of the states' error at the elements' edges, on smooth problems

    @property
    def collocated(self) -> Indices:
        """Indices of the nodes at which the flow is used."""
        return np.flatnonzero(np.any(self.A != 0.0, axis=0))

    @property
    def weighted(self) -> Indices:
        """Indices of the nodes at which integrands are used: their weight is not zero."""
        return np.flatnonzero(self.quadrature)

    def growth(self, points: Array) -> Array:
        """By how much the state has grown at `points` (m,), per unit of h.

        The integral from 0 of the polynomial through the rates at `collocated`, as a matrix that
        acts on these rates: shape (m, how many are collocated).
        """
        used = self.nodes[self.collocated]
        s, gauss = np.polynomial.legendre.leggauss(len(used))
        inside = 0.5 * np.asarray(points)[:, None] * (s + 1)
        basis = lagrange_matrix(used, inside.ravel()).reshape(*inside.shape, -1)
        return np.asarray(0.5 * np.asarray(points)[:, None] * (gauss @ basis))


class SchemeFamily(NamedTuple):
    """The schemes of one name, by degree of the state and highest degree of the control or None.

    `degree` is that of the state, if all elements have the same one.
    """

    of_degree: Callable[[int, int | None], Scheme]
    degree: int | None = None


@lru_cache
def trapezoid() -> Scheme:
    """Trapezoidal collocation, of order 2: x1 - x0 = h/2 (f0 + f1), and a linear control.

    Betts, Practical Methods for Optimal Control, 2nd ed., 4.7.2; Kelly, An Introduction to
    Trajectory Optimization, SIAM Review 59 (2017), 3.
    """
    return Scheme(
        nodes=np.array([0.0, 1.0]),
        D=np.array([[-1.0, 1.0]]),
        A=np.array([[0.5, 0.5]]),
        quadrature=np.array([0.5, 0.5]),
        control_nodes=np.array([0.0, 1.0]),
        control_basis=np.eye(2),
        control_values=np.eye(2),
        shared_controls=True,
        order=2,
    )


@lru_cache
def hermite_simpson() -> Scheme:
    """Hermite-Simpson collocation, separated, of order 4: a cubic state and a quadratic control.

        x_m = (x0 + x1)/2 + h/8 (f0 - f1),    x1 - x0 = h/6 (f0 + 4 f_m + f1)

    Hargraves and Paris, Direct Trajectory Optimization (1987); Betts, Practical Methods for
    Optimal Control, 2nd ed., 4.7.2; Kelly, SIAM Review 59 (2017), 4.
    """
    nodes = np.array([0.0, 0.5, 1.0])
    return Scheme(
        nodes=nodes,
        D=np.array([[-0.5, 1.0, -0.5], [-1.0, 0.0, 1.0]]),
        A=np.array([[1 / 8, 0.0, -1 / 8], [1 / 6, 4 / 6, 1 / 6]]),
        quadrature=np.array([1 / 6, 4 / 6, 1 / 6]),
        control_nodes=nodes,
        control_basis=np.eye(3),
        control_values=np.eye(3),
        shared_controls=True,
        order=4,
    )


@lru_cache
def radau(degree: int, control_degree: int | None = None) -> Scheme:
    """Legendre-Gauss-Radau collocation of degree d >= 1, at the flipped Radau points.

    On every element the state is a polynomial of degree d that satisfies the differential equation
    at the d flipped Radau points, the last of which is the element's end. As an integrator this is
    Radau IIA, of order 2d - 1 at the edges (Hairer and Wanner, Solving ODEs II, IV.5; for optimal
    control Garg et al., A unified framework, Automatica 46 (2010)). The control is a Bezier
    polynomial of lower degree and may jump at the elements' edges:

    - It lies in the convex hull of its coefficients, so that bounds on these hold everywhere.
    - Within an element it is smooth, and so is the state, which converges at full order.
    - Slacks and path constraints are imposed at the Radau points and on both sides of every edge.
      They outnumber the control's degrees of freedom and leave it no room to cheat in between.

    Args:
        degree: of the state.
        control_degree: of the control, from 0 to max(1, degree - 1), the default.
    """
    nodes, most = radau_nodes(degree), max(1, degree - 1)
    control_degree = most if control_degree is None else min(control_degree, most)
    knots = control_nodes(control_degree)
    return Scheme(
        nodes=nodes,
        D=differentiation_matrix(degree),
        A=np.hstack([np.zeros((degree, 1)), np.eye(degree)]),
        quadrature=np.concatenate([[0.0], quadrature_weights(degree)]),
        control_nodes=knots,
        control_basis=bernstein_matrix(control_degree, nodes),
        control_values=bernstein_matrix(control_degree, knots),
        shared_controls=False,
        order=2 * degree - 1,
    )


SCHEMES = {
    "trapezoid": SchemeFamily(lambda degree, control_degree: trapezoid(), degree=2),
    "hermite-simpson": SchemeFamily(lambda degree, control_degree: hermite_simpson(), degree=3),
    "radau": SchemeFamily(radau),
}


# -- polynomials on [0, 1] -----------------------------------------------------------------------


def barycentric_weights(nodes: Array) -> Array:
    """Weights of the barycentric Lagrange formula (Berrut and Trefethen, 2004)."""
    differences = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(differences, 1.0)
    return np.asarray(1.0 / differences.prod(axis=1))


def lagrange_matrix(nodes: Array, points: Array) -> Array:
    """Values at `points` (m,) of the Lagrange polynomials of `nodes` (n,): shape (m, n)."""
    distance = points[:, None] - nodes[None, :]
    exact = distance == 0.0
    terms = barycentric_weights(nodes) / np.where(exact, 1.0, distance)
    hit = exact.any(axis=1)
    terms[hit] = exact[hit]
    return np.asarray(terms / terms.sum(axis=1, keepdims=True))


@lru_cache
def radau_nodes(degree: int) -> Array:
    """0 followed by the `degree` flipped Radau points in (0, 1], shape (degree + 1,)."""
    inner = roots_jacobi(degree - 1, 1.0, 0.0)[0] if degree > 1 else np.empty(0)
    nodes = np.array([0.0, *(0.5 + 0.5 * inner), 1.0])
    nodes.setflags(write=False)
    return nodes


@lru_cache
def full_differentiation_matrix(nodes: tuple[float, ...]) -> Array:
    """Derivatives at nodes (n,) from values there, shape (n, n)."""
    points = np.array(nodes)
    w = barycentric_weights(points)
    gap = points[:, None] - points[None, :]
    np.fill_diagonal(gap, 1.0)
    matrix = (w[None, :] / w[:, None]) / gap
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return np.asarray(matrix)


def differentiation_matrix(degree: int) -> Array:
    """D (degree, degree + 1): derivatives at the Radau points from values at `radau_nodes`."""
    return full_differentiation_matrix(tuple(radau_nodes(degree)))[1:]


@lru_cache
def quadrature_weights(degree: int) -> Array:
    """Weights of the Radau points on [0, 1], shape (degree,)."""
    return interpolatory_weights(radau_nodes(degree)[1:])


def interpolatory_weights(nodes: Array) -> Array:
    """Integrals over [0, 1] of the Lagrange polynomials of `nodes` (n,), shape (n,)."""
    s, gauss = np.polynomial.legendre.leggauss(len(nodes))
    return np.asarray(0.5 * gauss @ lagrange_matrix(nodes, 0.5 * (s + 1)))


@lru_cache
def control_nodes(degree: int) -> Array:
    """Chebyshev-Lobatto points in [0, 1] that carry the control's values, shape (degree + 1,).

    Of degree 0, the middle.
    """
    if degree == 0:
        return np.array([0.5])
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree))


def bernstein_matrix(degree: int, points: Array) -> Array:
    """Values at `points` (m,) of the Bernstein polynomials: shape (m, degree + 1)."""
    s = np.asarray(points)[:, None]
    k = np.arange(degree + 1)
    return np.asarray(comb(degree, k) * s**k * (1 - s) ** (degree - k))
