"""What a scheme is: a linear relation between states and rates on one element."""

from __future__ import annotations

import dataclasses

import numpy as np

from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.transcribe.schemes.polynomials import lagrange_matrix


@dataclasses.dataclass(frozen=True, eq=False)
class Scheme:
    """D X = h A F on an element of length h, with F = flow at the nodes.

    Between the nodes, the state is the integral of the polynomial through the rates at the nodes
    that A uses. The control is another polynomial.

    Attributes:
        nodes: where states are unknowns, in [0, 1], the first 0 and the last 1, shape (n,).
        D: shape (r, n); r rows of defects per state.
        A: shape (r, n); the flow is not used at nodes whose column is zero.
        quadrature: weights of the nodes for integrals over [0, 1], shape (n,).
        control_nodes: m nodes of the control polynomial, in [0, 1].
        control_basis: control at `nodes` from its m coefficients, shape (n, m).
        control_values: control at `control_nodes` from its coefficients, shape (m, m).
        shared_controls: whether neighbours share the coefficients at their common edge, so that
            the control is continuous; otherwise it may jump there.
        order: of the states' error at the elements' edges, on smooth problems.
    """

    nodes: Array
    D: Array
    A: Array
    quadrature: Array
    control_nodes: Array
    control_basis: Array
    control_values: Array
    shared_controls: bool
    order: int

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
