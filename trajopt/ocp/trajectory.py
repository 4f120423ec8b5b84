"""Trajectories: states and controls as piecewise polynomials, and the arrays that store them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import real_array
from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.schemes import lagrange_matrix

#: Times that differ by less than this fraction of their phase are the same. Otherwise rounding
#: would decide on which side of an edge a time lies that is meant to be on it.
SAME_TIME = 1e-12


@dataclasses.dataclass(frozen=True)
class PhaseTrajectory:
    """State and control of one phase, as polynomials on the elements of a mesh.

    The control may jump at the elements' edges; there it is the limit from the right, unless the
    limit from the left is asked for.

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

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            array = real_array(field.name, getattr(self, field.name))
            object.__setattr__(self, field.name, array.astype(np.float64, copy=False))
        elements = len(self.edges) - 1
        for name, nodes in (("states", self.nodes), ("controls", self.control_nodes)):
            shape = getattr(self, name).shape
            if len(shape) != 3 or shape[:2] != (elements, len(nodes)):
                raise ValueError(f"{name}: of shape {shape}, not ({elements}, {len(nodes)}, any)")

    def require_sound(self, where: str) -> None:
        """Refuse a trajectory whose edges or nodes are not in order, with a ValueError."""
        for name in ("edges", "nodes", "control_nodes"):
            array = getattr(self, name)
            if not (np.diff(array) > 0.0).all() or array[0] < 0.0:
                raise ValueError(f"{where}: {name} = {array}: must increase from 0")
        if self.edges[0] != 0.0 or self.nodes[0] != 0.0 or self.nodes[-1] != 1.0:
            raise ValueError(f"{where}: edges and nodes must begin with 0, and nodes end with 1")

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
        element, s = self._locate(t, "right")
        basis = lagrange_matrix(self.nodes, s)
        return np.asarray(np.einsum("tn,tnx->tx", basis, self.states[element]))

    def control(self, t: ArrayLike, side: str = "right") -> Array:
        """Control at times t (N,), shape (N, nu); `side` "left" or "right" of jumps."""
        element, s = self._locate(t, side)
        basis = lagrange_matrix(self.control_nodes, s)
        return np.asarray(np.einsum("tn,tnx->tx", basis, self.controls[element]))

    @cached_property
    def element_durations(self) -> Array:
        """Durations of the elements (s), shape (M,)."""
        return np.diff(self.edges)

    def _locate(self, times: ArrayLike, side: str) -> tuple[Indices, Array]:
        """The element in which each time lies, and where in it, from 0 to 1."""
        t = np.atleast_1d(real_array("t", times))
        require_side(side)
        past = t + SAME_TIME * self.duration if side == "right" else t - SAME_TIME * self.duration
        where = np.searchsorted(self.edges, past, side="right" if side == "right" else "left") - 1
        element = np.clip(where, 0, len(self.edges) - 2)
        return element, (t - self.edges[element]) / self.element_durations[element]


def require_side(side: str) -> None:
    """Refuse a `side` of a jump that is neither "left" nor "right", with a ValueError."""
    if not isinstance(side, str) or side not in ("left", "right"):
        raise ValueError(f"side = {side!r}: choose 'left' or 'right'")


_FIELDS = tuple(field.name for field in dataclasses.fields(PhaseTrajectory))


def phases_to_arrays(phases: Sequence[PhaseTrajectory]) -> dict[str, NDArray[Any]]:
    """The arrays of a trajectory by name: "phase0_edges" and so on."""
    return {
        f"phase{i}_{name}": getattr(phase, name)
        for i, phase in enumerate(phases)
        for name in _FIELDS
    }


def phases_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> tuple[PhaseTrajectory, ...]:
    """The trajectory in arrays that `phases_to_arrays` named."""
    phases: list[PhaseTrajectory] = []
    while f"phase{len(phases)}_edges" in arrays:
        name = f"phase{len(phases)}"
        phases.append(PhaseTrajectory(*(arrays[f"{name}_{field}"] for field in _FIELDS)))
    return tuple(phases)
