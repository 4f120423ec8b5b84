"""Polynomials on [0, 1]: nodes, interpolation, differentiation, quadrature, Bezier form."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import comb, roots_jacobi

from trajopt.ocp.arrays import Array


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
    points = radau_nodes(degree)[1:]
    s, gauss = np.polynomial.legendre.leggauss(degree)
    return np.asarray(0.5 * gauss @ lagrange_matrix(points, 0.5 * (s + 1)))


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
