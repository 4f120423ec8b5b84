"""What a transcription is: a linear relation between states and rates on one element."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from trajopt.ocp.transcribe.schemes.polynomials import lagrange_matrix

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Scheme:
    """D X = h A F on an element of length h, with F = flow at the nodes.

    The state between the nodes is the integral of the polynomial through the rates at those
    nodes that A uses; the control is a polynomial of its own.

    Attributes:
        nodes: in [0, 1], the first 0 and the last 1, where states are unknowns, shape (n,).
        D: shape (r, n); r rows of defects per state.
        A: shape (r, n); columns of zeros are nodes at which the flow is not used.
        quadrature: weights of the nodes for integrals over [0, 1], shape (n,).
        control_nodes: where the control polynomial's values are given, m of them, in [0, 1].
        control_basis: control at `nodes` from its m coefficients, shape (n, m).
        control_values: control at `control_nodes` from its coefficients, shape (m, m).
        shared_controls: whether the first and last coefficient belong to the neighbours as well
            (a continuous control) or not (it may jump between elements).
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
    def collocated(self) -> NDArray[np.intp]:
        """Indices of the nodes at which the flow is used."""
        return np.flatnonzero(np.any(self.A != 0.0, axis=0))

    @property
    def weighted(self) -> NDArray[np.intp]:
        """Indices of the nodes at which integrands are used."""
        return np.flatnonzero(self.quadrature)

    def growth(self, points: Array) -> Array:
        """State at `points` (m,) less that at 0, per unit of h, from the rates at `collocated`.

        The integral of the polynomial through them; shape (m, how many are collocated).
        """
        used = self.nodes[self.collocated]
        s, gauss = np.polynomial.legendre.leggauss(len(used))
        inside = 0.5 * np.asarray(points)[:, None] * (s + 1)
        basis = lagrange_matrix(used, inside.ravel()).reshape(*inside.shape, -1)
        return np.asarray(0.5 * np.asarray(points)[:, None] * (gauss @ basis))
