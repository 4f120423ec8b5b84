"""Where the unknowns of a discretised problem lie in one long vector."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.pose.bounds import pair
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.transcribe.element import powers
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.schemes import Scheme


@dataclasses.dataclass(frozen=True)
class Group:
    """The elements of one degree of a phase.

    Attributes:
        degree: of the state.
        scheme: of that degree.
        elements: their indices, ascending.
    """

    degree: int
    scheme: Scheme
    elements: Indices


def groups(mesh: Mesh, phase: int) -> tuple[Group, ...]:
    """The elements of a phase by degree."""
    degrees = np.array(mesh.degrees[phase])
    return tuple(
        Group(int(d), mesh.scheme_of_degree(int(d)), np.flatnonzero(degrees == d))
        for d in np.unique(degrees)
    )


#: (phase, kind, degree). A phase as a whole has the kinds "duration", "edges" and "edge controls"
#: (degree 0), its elements of one degree have "interior", "controls" and "slacks"; the static
#: parameters are (-1, "parameters", 0).
Key = tuple[int, str, int]


class Layout:
    """Shapes and places of a problem's unknowns on a mesh; matrices are in column-major order.

    Attributes:
        problem: whose unknowns they are.
        mesh: that discretises it.
        shapes: of the unknowns of every key, in order.
        cuts: where each begins in the vector, and the vector's end.
        size: of the vector.
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        self.problem, self.mesh = problem, mesh
        self.shapes: dict[Key, tuple[int, int]] = {}
        for i, phase in enumerate(problem.phases):
            for name, shape in self._phase_shapes(i, phase):
                self.shapes[name] = shape
        self.shapes[-1, "parameters", 0] = (len(problem.parameters), 1)
        sizes = [rows * columns for rows, columns in self.shapes.values()]
        self.cuts = np.cumsum([0, *sizes])
        self.size = int(self.cuts[-1])
        self._indices = self.split(np.arange(self.size))

    def _phase_shapes(self, index: int, phase: Phase) -> Iterator[tuple[Key, tuple[int, int]]]:
        nx, nu, n = len(phase.states), len(phase.controls), len(self.mesh.degrees[index])
        yield (index, "duration", 0), (1, 1)
        yield (index, "edges", 0), (nx, n + 1)
        for group in groups(self.mesh, index):
            scheme, count = group.scheme, len(group.elements)
            own = len(scheme.control_nodes) - (2 if scheme.shared_controls else 0)
            k = powers(phase)
            yield (index, "interior", group.degree), (nx * (len(scheme.nodes) - 2), count)
            yield (index, "controls", group.degree), (nu * own, count)
            yield (index, "slacks", group.degree), (k * len(scheme.weighted), count)
            if scheme.shared_controls:
                yield (index, "edge controls", 0), (nu, n + 1)

    def indices(self, *key: Any) -> Indices:
        """Where the unknowns of a key lie in the vector, in their shape."""
        return self._indices[key]

    def split(self, w: NDArray[Any]) -> dict[Key, NDArray[Any]]:
        """The parts of a vector, by key."""
        return {
            key: w[first:last].reshape(shape, order="F")
            for (key, shape), first, last in zip(
                self.shapes.items(), self.cuts[:-1], self.cuts[1:], strict=True
            )
        }

    def join(self, parts: dict[Key, Array]) -> Array:
        """The vector of these parts; a single column stands for all columns of its shape."""
        return np.concatenate(
            [
                np.broadcast_to(parts[key], shape).ravel(order="F")
                for key, shape in self.shapes.items()
            ]
        )

    def bounds(self, problem: Problem) -> tuple[Array, Array]:
        """(lower, upper) of all unknowns."""
        return self._bounds(problem, 0), self._bounds(problem, 1)

    def _bounds(self, problem: Problem, side: int) -> Array:
        parts: dict[Key, Array] = {}
        for key, (rows, columns) in self.shapes.items():
            index, kind, _ = key
            if index < 0:
                each = [pair(b)[side] for b in problem.parameters.values()]
                parts[key] = np.array(each).reshape(-1, 1)
                continue
            phase = problem.phases[index]
            along, controls = phase.state_bounds()[side], phase.control_bounds()[side]
            if kind == "edges":
                parts[key] = np.repeat(along[:, None], columns, axis=1)
                parts[key][:, 0] = phase.state_bounds("start")[side]
                parts[key][:, -1] = phase.state_bounds("end")[side]
            elif kind == "slacks":
                parts[key] = np.array((phase.floor, np.inf)[side])
            elif kind == "duration":
                parts[key] = np.array(pair(phase.duration)[side])
            else:
                own = along if kind == "interior" else controls
                times = rows // len(own) if len(own) else 0
                parts[key] = np.tile(own, times)[:, None]
        return self.join(parts)
