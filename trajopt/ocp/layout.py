"""The unknowns of a discretised problem as one long vector, from a trajectory and back to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import real_array
from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.constraints import pair
from trajopt.ocp.mesh import Group, Mesh
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.schemes import lagrange_matrix, radau_nodes
from trajopt.ocp.trajectory import PhaseTrajectory

#: (phase, kind, degree). A phase as a whole has the kinds "duration", "edges" and "edge controls"
#: (degree 0), its elements of one degree have "interior", "controls" and "slacks"; the static
#: parameters are (-1, "parameters", 0).
Key = tuple[int, str, int]


class Layout:
    """Shapes and places of a problem's unknowns on a mesh; matrices are in column-major order.

    Attributes:
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
        for group in self.mesh.groups(index):
            scheme, count = group.scheme, len(group.elements)
            free = len(scheme.control_nodes) - (2 if scheme.shared_controls else 0)
            k = power_count(phase)
            yield (index, "interior", group.degree), (nx * (len(scheme.nodes) - 2), count)
            yield (index, "controls", group.degree), (nu * free, count)
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
        columns = (np.broadcast_to(parts[key], shape) for key, shape in self.shapes.items())
        return np.concatenate([each.ravel(order="F") for each in columns])

    def bounds(self, problem: Problem) -> tuple[Array, Array]:
        """(lower, upper) of all unknowns."""
        return self._bounds(problem, 0), self._bounds(problem, 1)

    def _bounds(self, problem: Problem, side: int) -> Array:
        parts: dict[Key, Array] = {}
        for key, (rows, columns) in self.shapes.items():
            index, kind, _ = key
            if index < 0:
                fixed = [pair(b)[side] for b in problem.parameters.values()]
                parts[key] = np.array(fixed).reshape(-1, 1)
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
                each = along if kind == "interior" else controls
                times = rows // len(each) if len(each) else 0
                parts[key] = np.tile(each, times)[:, None]
        return self.join(parts)


def pack(
    layout: Layout,
    problem: Problem,
    guess: Sequence[PhaseTrajectory],
    parameters: Array | None = None,
) -> Array:
    """The unknowns at a guess, one trajectory per phase, on any mesh.

    Durations are scaled so that their sum is within its bounds. Static parameters that are not
    given are in the middle of their bounds.
    """
    _require_fit(problem, guess)
    p = middle(problem) if parameters is None else real_array("parameters", parameters)
    if p.shape != (len(problem.parameters),):
        raise ValueError(f"parameters = {p}: give one number each for {tuple(problem.parameters)}")
    parts: dict[Key, Array] = {(-1, "parameters", 0): p.reshape(-1, 1)}
    low, high = pair(problem.duration)
    total = float(np.cumsum([trajectory.duration for trajectory in guess])[-1])
    scale = min(max(total, low), high) / total
    for i, (phase, trajectory) in enumerate(zip(problem.phases, guess, strict=True)):
        edges = trajectory.duration * np.array(layout.mesh.fractions[i])
        parts[i, "duration", 0] = np.array([[trajectory.duration * scale]])
        parts[i, "edges", 0] = trajectory.state(edges).T
        parts[i, "edge controls", 0] = np.concatenate(
            [trajectory.control(edges[:-1]), trajectory.control(edges[-1:], "left")]
        ).T
        for group in layout.mesh.groups(i):
            packed = _pack_group(phase, group, trajectory, edges, p)
            parts |= {(i, kind, group.degree): values for kind, values in packed.items()}
    return layout.join(parts)


def _require_fit(problem: Problem, guess: Sequence[PhaseTrajectory]) -> None:
    if len(guess) != len(problem.phases):
        raise ValueError(
            f"the guess has {len(guess)} trajectories for the {len(problem.phases)} phases: "
            "give one for each"
        )
    for phase, trajectory in zip(problem.phases, guess, strict=True):
        given = trajectory.states.shape[-1], trajectory.controls.shape[-1]
        if given != (len(phase.states), len(phase.controls)):
            raise ValueError(
                f"the guess of phase {phase.name!r}: {given[0]} states and {given[1]} controls "
                f"for {phase.states} and {phase.controls}"
            )
        trajectory.require_sound(f"the guess of phase {phase.name!r}")


def _pack_group(
    phase: Phase, group: Group, trajectory: PhaseTrajectory, edges: Array, p: Array
) -> dict[str, Array]:
    scheme, count = group.scheme, len(group.elements)
    left, h = edges[group.elements, None], np.diff(edges)[group.elements, None]
    states = _sampled(trajectory.state, left + h * scheme.nodes)
    knots = scheme.control_nodes
    controls = _sampled(trajectory.control, left + h * knots)
    controls[:, -1] = trajectory.control((left + h)[:, 0], "left")
    coefficients = np.linalg.solve(scheme.control_values, controls)
    free = coefficients[:, 1:-1] if scheme.shared_controls else coefficients
    slacks = np.zeros((0, count))
    if phase.powers is not None:
        used = scheme.weighted
        at_nodes = scheme.control_basis[used] @ coefficients
        power = evaluated(phase.powers, states[:, used], at_nodes, p)
        slacks = _columns(np.maximum(power, phase.floor))
    return {"interior": _columns(states[:, 1:-1]), "controls": _columns(free), "slacks": slacks}


def _sampled(function: Callable[[Array], Array], times: Array) -> Array:
    values = function(times.ravel())
    return np.array(values.reshape(*times.shape, values.shape[-1]))


def _columns(values: NDArray[Any]) -> Array:
    """Values (elements, nodes, m) as one column per element; any of the sizes may be 0."""
    return values.reshape(len(values), math.prod(values.shape[1:])).T


def unpack(layout: Layout, w: Array) -> tuple[PhaseTrajectory, ...]:
    """The trajectory that the unknowns describe."""
    parts = layout.split(w)
    phases = range(len(layout.problem.phases))
    return tuple(_unpack_phase(layout, i, parts) for i in phases)


def _unpack_phase(layout: Layout, i: int, parts: dict[Key, Array]) -> PhaseTrajectory:
    phase, fractions = layout.problem.phases[i], np.array(layout.mesh.fractions[i])
    T, edges = float(parts[i, "duration", 0][0, 0]), parts[i, "edges", 0]
    nx, nu, count = len(phase.states), len(phase.controls), len(fractions) - 1
    every = layout.mesh.groups(i)
    nodes = radau_nodes(max(group.degree for group in every))
    knots = max((group.scheme.control_nodes for group in every), key=len)
    states, controls = np.empty((count, len(nodes), nx)), np.empty((count, len(knots), nu))
    for group in every:
        scheme, chosen = group.scheme, group.elements
        inner = parts[i, "interior", group.degree].T.reshape(len(chosen), -1, nx)
        left, right = edges[:, chosen].T[:, None], edges[:, chosen + 1].T[:, None]
        X = np.concatenate([left, inner, right], axis=1)
        m = len(scheme.control_nodes) - (2 if scheme.shared_controls else 0)
        coefficients = parts[i, "controls", group.degree].T.reshape(len(chosen), m, nu)
        if scheme.shared_controls:
            shared = parts[i, "edge controls", 0]
            first, last = shared[:, chosen].T[:, None], shared[:, chosen + 1].T[:, None]
            coefficients = np.concatenate([first, coefficients, last], axis=1)
        values = scheme.control_values @ coefficients
        controls[chosen] = lagrange_matrix(scheme.control_nodes, knots) @ values
        used, U = scheme.collocated, scheme.control_basis @ coefficients
        p = parts[-1, "parameters", 0].ravel()
        F = evaluated(phase.flow, X[:, used], U[:, used], p)
        grown = X[:, :1] + T * np.diff(fractions)[chosen, None, None] * (scheme.growth(nodes) @ F)
        # The gap that the solver's tolerance leaves at the right end is spread over the element.
        states[chosen] = grown + nodes[:, None] * (right - grown[:, -1:])
    return PhaseTrajectory(T * fractions, nodes, states, knots, controls)


def evaluated(function: Any, states: Array, controls: Array, p: Array) -> Array:
    """A traced function of (x, u, p) at states (..., nx) and controls (..., nu): (..., m)."""
    shape = states.shape[:-1]
    count = math.prod(shape)
    columns = (a.reshape(count, a.shape[-1]).T for a in (states, controls))
    values = np.asarray(function(*columns, np.repeat(p[:, None], count, axis=1)))
    return values.T.reshape(*shape, len(values))


def running_cost(phase: Phase, x: Array, u: Array, p: Array) -> Array:
    """The running cost at states (..., nx) and controls (..., nu)."""
    cost = np.zeros(x.shape[:-1])
    if phase.cost is not None:
        cost = cost + evaluated(phase.cost, x, u, p)[..., 0]
    if phase.powers is not None:
        cost = cost + np.maximum(evaluated(phase.powers, x, u, p), phase.floor).sum(axis=-1)
    return np.asarray(cost)


def middle(problem: Problem) -> Array:
    """Static parameters in the middle of their bounds, shape (np,).

    With a single finite bound, they are at that bound; without any, 0.
    """
    limits = np.array([pair(b) for b in problem.parameters.values()]).reshape(-1, 2)
    return np.nan_to_num(middles(*limits.T))


def middles(lower: Array, upper: Array) -> Array:
    """Middles of bounds (n,): the finite one where there is only one, NaN where there is none."""
    both = np.isfinite(lower) & np.isfinite(upper)
    one = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper, np.nan))
    return np.where(both, 0.5 * (np.where(both, lower, 0.0) + np.where(both, upper, 0.0)), one)


def power_count(phase: Phase) -> int:
    """How many powers a traced phase has."""
    return phase.powers.size1_out(0) if isinstance(phase.powers, ca.Function) else 0
