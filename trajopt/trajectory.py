"""Piecewise polynomials on a mesh: what a transcription's unknowns mean between its nodes."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.schemes.polynomials import lagrange_matrix

Array = NDArray[np.float64]

#: Times that differ by less than this fraction of their phase are the same: on which side of an
#: edge a time is that was computed to lie on it, rounding alone would decide.
SAME_TIME = 1e-12


@dataclasses.dataclass(frozen=True)
class PhaseTrajectory:
    """State and control of one phase, as polynomials on the elements of a mesh.

    The control may jump at the elements' edges; it is right-continuous there unless asked for
    the limit from the left.

    Attributes:
        edges: times of the M + 1 element edges, from 0 (s).
        nodes: the state polynomial's nodes in [0, 1], n of them, the first 0 and the last 1.
        states: values at the nodes, shape (M, n, nx).
        control_nodes: the control polynomial's nodes in [0, 1], m of them.
        controls: values there, shape (M, m, nu).
    """

    edges: Array
    nodes: Array
    states: Array
    control_nodes: Array
    controls: Array

    @property
    def duration(self) -> float:
        """Duration (s)."""
        return float(self.edges[-1])

    @property
    def start(self) -> Array:
        """State at the start, shape (nx,)."""
        return np.asarray(self.states[0, 0])

    @property
    def end(self) -> Array:
        """State at the end, shape (nx,)."""
        return np.asarray(self.states[-1, -1])

    def state(self, t: ArrayLike) -> Array:
        """State at times t (N,), shape (N, nx); extrapolated outside the phase."""
        element, s = self._locate(np.atleast_1d(np.asarray(t, dtype=float)), "right")
        basis = lagrange_matrix(self.nodes, s)
        return np.asarray(np.einsum("tn,tnx->tx", basis, self.states[element]))

    def control(self, t: ArrayLike, side: str = "right") -> Array:
        """Control at times t (N,), shape (N, nu)."""
        element, s = self._locate(np.atleast_1d(np.asarray(t, dtype=float)), side)
        basis = lagrange_matrix(self.control_nodes, s)
        return np.asarray(np.einsum("tn,tnx->tx", basis, self.controls[element]))

    @cached_property
    def element_durations(self) -> Array:
        """Durations of the elements (s), shape (M,)."""
        return np.diff(self.edges)

    def _locate(self, t: Array, side: str) -> tuple[NDArray[np.intp], Array]:
        past = t + SAME_TIME * self.duration if side == "right" else t - SAME_TIME * self.duration
        where = np.searchsorted(self.edges, past, side="right" if side == "right" else "left") - 1
        element = np.clip(where, 0, len(self.edges) - 2)
        return element, (t - self.edges[element]) / self.element_durations[element]
