"""The equations of a problem on a mesh: rows of constraints, and the blocks that compute them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.constraints import NOTEWORTHY, Violation, pair
from trajopt.ocp.layout import Layout, power_count
from trajopt.ocp.mesh import Group, Mesh
from trajopt.ocp.problem import Linkage, Phase, Problem
from trajopt.ocp.program import Block
from trajopt.ocp.scaling import Scales
from trajopt.ocp.schemes import Scheme
from trajopt.ocp.trajectory import PhaseTrajectory

_START, _END = np.zeros(1), np.ones(1)  # fractions of a phase


@dataclasses.dataclass(frozen=True)
class Rows:
    """Constraints of one kind."""

    # "differential equation", "path constraint", "slack", "integral", "start constraint", "end
    # constraint", "linkage", "total duration" or "boundary"
    kind: str
    phase: int  # index of the phase, -1 for the problem as a whole
    names: tuple[str, ...]  # of the rows at one place; every place has the same
    fractions: Array  # where the places are, as fractions of the phase's duration
    degree: int  # of the elements that the rows belong to, 0 if none
    count: int  # how many rows there are in all


@dataclasses.dataclass(frozen=True)
class ElementBlock:
    """The block that is applied once to each element of one degree of a phase (its index)."""

    phase: int
    group: Group
    block: Block


class Equations:
    """All constraints and costs of a problem on a mesh.

    Attributes:
        rows: what the rows of g mean, in order.
        blocks: functions whose outputs add up to g, and whose costs add up to f.
        element_blocks: those of them that belong to elements.
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        self.problem, self.mesh = problem, mesh
        self.layout = Layout(problem, mesh)
        self.rows: list[Rows] = []
        self.element_blocks: list[ElementBlock] = []
        self.blocks = tuple(self._build())

    @property
    def count(self) -> int:
        """How many rows g has."""
        return sum(rows.count for rows in self.rows)

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> Iterator[Block]:
        for i in range(len(self.problem.phases)):
            yield from self._elements(i)
            yield from self._end_constraints(i)
        for link in self.problem.linkages:
            yield self._linkage(link)
        yield from self._whole()

    def _elements(self, i: int) -> Iterator[Block]:
        """The blocks of a phase's elements, by degree; path constraints at its end besides."""
        phase, fractions = self.problem.phases[i], np.array(self.mesh.fractions[i])
        indices = self.layout.indices
        edges, p = indices(i, "edges", 0), indices(-1, "parameters", 0)
        totals = self._rows("integral", i, phase.integral.names, _START) if phase.integral else None
        for group in self.mesh.groups(i):
            scheme, chosen, d = group.scheme, group.elements, group.degree
            controls = indices(i, "controls", d)
            if scheme.shared_controls:
                shared = indices(i, "edge controls", 0)
                controls = np.vstack([shared[:, chosen], controls, shared[:, chosen + 1]])
            widths = np.diff(fractions)[chosen]
            repeated = [np.repeat(a, len(chosen), axis=1) for a in (indices(i, "duration", 0), p)]
            variables = np.vstack(
                [
                    *(edges[:, chosen], indices(i, "interior", d), edges[:, chosen + 1], controls),
                    *(indices(i, "slacks", d), *repeated),
                ]
            )
            places = fractions[chosen] + widths * scheme.nodes[:, None]  # (n, elements)
            kind = "differential equation"
            rows = [self._rows(kind, i, phase.states, places[-len(scheme.D) :], d)]
            if phase.path:
                where = places[path_nodes(scheme)]
                rows.append(self._rows("path constraint", i, phase.path.names, where, d))
            if phase.powers:
                names = tuple(f"power {k}" for k in range(power_count(phase)))
                rows.append(self._rows("slack", i, names, places[scheme.weighted], d))
            if totals is not None:
                rows.append(np.repeat(totals, len(chosen), axis=1))
            function = element(phase, scheme, len(p))
            block = Block(function, variables, np.vstack(rows), widths[None])
            self.element_blocks.append(ElementBlock(i, group, block))
            yield block
            if scheme.shared_controls and phase.path:
                last = edges[:, -1], shared[:, -1], p[:, 0]
                rows_here = self._rows("path constraint", i, phase.path.names, _END)
                yield _once(phase.path.function, last, rows_here)

    def _end_constraints(self, i: int) -> Iterator[Block]:
        """What is imposed at the start and at the end of a phase."""
        phase, edges = self.problem.phases[i], self.layout.indices(i, "edges", 0)
        p = self.layout.indices(-1, "parameters", 0)[:, 0]
        if phase.at_start:
            rows = self._rows("start constraint", i, phase.at_start.names, _START)
            yield _once(phase.at_start.function, (edges[:, 0], p), rows)
        if phase.at_end:
            rows = self._rows("end constraint", i, phase.at_end.names, _END)
            yield _once(phase.at_end.function, (edges[:, -1], p), rows)

    def _linkage(self, link: Linkage) -> Block:
        indices = self.layout.indices
        source, target = self.problem.phases[link.source], self.problem.phases[link.target]
        before = indices(link.source, "edges", 0)[:, -1]
        after = indices(link.target, "edges", 0)[:, 0]
        names = tuple(f"{n} from {source.name!r}" for n in target.states)

        def gap(x: ca.SX, y: ca.SX, p: ca.SX) -> ca.SX:
            return y - link.map(x, p)

        rows = self._rows("linkage", link.target, names, _START)
        return _once(gap, (before, after, indices(-1, "parameters", 0)[:, 0]), rows)

    def _whole(self) -> Iterator[Block]:
        """What concerns all phases: their total duration, the boundary, the endpoint cost."""
        problem, indices = self.problem, self.layout.indices
        phases = range(len(problem.phases))
        durations = np.concatenate([indices(i, "duration", 0)[:, 0] for i in phases])
        rows = self._rows("total duration", -1, ("",), _START)
        yield _once(ca.sum1, (durations,), rows)
        starts = np.concatenate([indices(i, "edges", 0)[:, 0] for i in phases])
        ends = np.concatenate([indices(i, "edges", 0)[:, -1] for i in phases])
        everything = starts, ends, durations, indices(-1, "parameters", 0)[:, 0]
        if problem.boundary is not None:
            rows = self._rows("boundary", -1, problem.boundary.names, _START)
            yield _once(problem.boundary.function, everything, rows)
        if problem.endpoint_cost is not None:
            yield _once(problem.endpoint_cost, everything, None)

    def _rows(
        self, kind: str, phase: int, names: Sequence[str], fractions: Array, degree: int = 0
    ) -> Indices:
        """New rows of g, shape (names x places, elements); `fractions` (places, elements)."""
        table = np.atleast_1d(fractions).reshape(len(fractions), -1)
        first, count = self.count, len(names) * table.size
        self.rows.append(Rows(kind, phase, tuple(names), table.ravel(order="F"), degree, count))
        shape = (len(names) * len(table), table.shape[1])
        return np.arange(first, first + count).reshape(shape, order="F")

    # -- bounds and violations ----------------------------------------------------------------

    def bounds(self, problem: Problem) -> tuple[Array, Array]:
        """(lower, upper) of g, for a problem with the same functions."""
        links = iter(problem.linkages)
        parts = [_row_bounds(rows, problem, links) for rows in self.rows]
        lower, upper = (np.concatenate(side) for side in zip(*parts, strict=True))
        return lower, upper

    def scales(self, scales: Scales) -> Array:
        """The scales of the rows of g, shape (count,)."""
        return np.concatenate([_row_scales(rows, scales) for rows in self.rows])

    def violations(
        self, excess: Array, scales: Scales, phases: Sequence[PhaseTrajectory], problem: Problem
    ) -> tuple[Violation, ...]:
        """The worst row of every kind that is violated, worst first, given every row's excess."""
        worst, first = [], 0
        for rows in self.rows:
            amounts = excess[first : first + rows.count]
            first += rows.count
            part = amounts / _row_scales(rows, scales)
            if not len(part) or part.max() < NOTEWORTHY:
                continue
            index = int(np.argmax(part))
            place = min(index // len(rows.names), len(rows.fractions) - 1)
            name, phase, time = rows.names[index % len(rows.names)], "", 0.0
            if rows.phase >= 0:
                phase = problem.phases[rows.phase].name
                time = float(rows.fractions[place] * phases[rows.phase].duration)
            sizes = float(amounts[index]), float(part[index])
            worst.append(Violation(rows.kind, name, phase, time, *sizes))
        return tuple(sorted(worst, key=lambda violation: -violation.relative))


def _once(function: Any, variables: Sequence[Indices], rows: Indices | None) -> Block:
    """A block that is applied once: constraints, or a cost where there are no rows."""
    v = ca.SX.sym("v", sum(map(len, variables)))
    value = function(*ca.vertsplit(v, np.cumsum([0, *map(len, variables)]).tolist()))
    outputs, cost = (value, ca.SX(0)) if rows is not None else (ca.SX(0, 1), value)
    traced = ca.Function("once", [v, ca.SX.sym("d", 0)], [ca.densify(outputs), cost])
    where = np.empty((0, 1), dtype=np.intp) if rows is None else rows
    return Block(traced, np.concatenate(variables)[:, None], where, np.empty((0, 1)))


def _row_bounds(rows: Rows, problem: Problem, links: Iterator[Linkage]) -> tuple[Array, Array]:
    zeros = np.zeros(rows.count)
    if rows.kind == "differential equation":
        return zeros, zeros
    if rows.kind == "slack":
        return zeros, zeros + np.inf
    if rows.kind == "linkage":
        offset = problem.offset(next(links))
        return offset, offset
    if rows.kind == "total duration":
        low, high = pair(problem.duration)
        return zeros + low, zeros + high
    constraint = problem.boundary
    if rows.kind != "boundary":
        names = "path constraint", "integral", "start constraint", "end constraint"
        phase = problem.phases[rows.phase]
        constraint = dict(zip(names, phase.constraints, strict=True))[rows.kind]
    assert constraint is not None  # the rows were made from it
    times = rows.count // len(rows.names)
    return np.tile(constraint.lower, times), np.tile(constraint.upper, times)


def _row_scales(rows: Rows, scales: Scales) -> Array:
    if rows.kind == "total duration":
        return np.array([max(phase.duration for phase in scales.phases)])
    if rows.kind == "boundary":
        return scales.boundary
    s = scales.phases[rows.phase]
    each = {
        "path constraint": s.path,
        "slack": s.powers,
        "integral": s.integral,
        "start constraint": s.at_start,
        "end constraint": s.at_end,
    }.get(rows.kind, s.states)
    return np.tile(each, rows.count // len(each))


def element(phase: Phase, scheme: Scheme, parameters: int) -> ca.Function:
    """The element's equations and cost: (v, width) -> (outputs, cost).

    v consists of the states at the left edge (nx), inside (nx (n - 2)) and at the right edge (nx),
    the controls (nu m), slacks (k w), the phase's duration, and p. The width is a fraction of that
    duration. The outputs are, in this order: defects (nx r), path constraints at `path_nodes`,
    slacks less powers (k w), integrals.
    """
    constraints = (c and c.function for c in (phase.path, phase.integral))
    functions = (phase.flow, phase.cost, phase.powers, *constraints)
    sizes = len(phase.states), len(phase.controls), parameters
    return _element(sizes, functions, scheme)


@lru_cache(maxsize=64)  # refinement needs the same ones again
def _element(
    sizes: tuple[int, int, int], functions: tuple[Any, ...], scheme: Scheme
) -> ca.Function:
    (nx, nu, parameters), (flow, running, power, path, integrand) = sizes, functions
    n, m = len(scheme.nodes), len(scheme.control_nodes)
    weighted, collocated = scheme.weighted, scheme.collocated
    k = power.size1_out(0) if power else 0
    counts = [nx, nx * (n - 2), nx, nu * m, k * len(weighted), 1, parameters]
    v, width = ca.SX.sym("v", sum(counts)), ca.SX.sym("width")
    cuts = np.cumsum([0, *counts]).tolist()
    left, interior, right, coefficients, slacks, duration, p = ca.vertsplit(v, cuts)
    h = width * duration
    X = ca.horzcat(left, ca.reshape(interior, nx, n - 2), right)
    U = ca.reshape(coefficients, nu, m) @ ca.DM(scheme.control_basis).T

    def values(function: Any, nodes: Indices) -> ca.SX:
        return ca.horzcat(*(function(X[:, int(j)], U[:, int(j)], p) for j in nodes))

    F = values(flow, collocated)
    defects = X @ ca.DM(scheme.D).T - h * (F @ ca.DM(scheme.A[:, collocated]).T)
    b = ca.DM(scheme.quadrature[weighted])
    cost, outputs = ca.SX(0), [ca.vec(defects)]
    if path:
        outputs.append(ca.vec(values(path, path_nodes(scheme))))
    if running:
        cost += h * (values(running, weighted) @ b)
    if power:
        costs = ca.reshape(slacks, k, len(weighted))
        outputs.append(ca.vec(costs - values(power, weighted)))
        cost += h * ca.sum1(costs @ b)
    if integrand:
        outputs.append(h * (values(integrand, weighted) @ b))
    return ca.Function("element", [v, width], [ca.densify(ca.vertcat(*outputs)), cost])


def path_nodes(scheme: Scheme) -> Indices:
    """Nodes at which an element imposes path constraints.

    Where controls are shared, an element's right end is left to its neighbour. Where they are not,
    the control has two limits at an edge, and both elements impose the constraint.
    """
    n = len(scheme.nodes)
    return np.arange(n - 1 if scheme.shared_controls else n)
