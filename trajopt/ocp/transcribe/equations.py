"""The equations of a problem on a mesh: rows of constraints, and the blocks that compute them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.pose.bounds import pair
from trajopt.ocp.pose.constraint import Constraint
from trajopt.ocp.pose.linkage import Linkage
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.transcribe.element import element, path_nodes, powers
from trajopt.ocp.transcribe.layout import Group, Layout, groups
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.program import Block
from trajopt.ocp.transcribe.rows import Rows

_START, _END = np.zeros(1), np.ones(1)  # fractions of a phase


@dataclasses.dataclass(frozen=True)
class ElementBlock:
    """The block of a phase's elements of one degree.

    Attributes:
        phase: index of the phase.
        group: the elements.
        block: applied once to each of them.
    """

    phase: int
    group: Group
    block: Block


class Equations:
    """All constraints and costs of a problem on a mesh.

    Attributes:
        problem: whose equations they are.
        mesh: that discretises it.
        layout: of the unknowns.
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
        at = self.layout.indices
        edges, p = at(i, "edges", 0), at(-1, "parameters", 0)
        totals = self._rows("integral", i, phase.integral.names, _START) if phase.integral else None
        for group in groups(self.mesh, i):
            scheme, chosen, d = group.scheme, group.elements, group.degree
            controls = at(i, "controls", d)
            if scheme.shared_controls:
                shared = at(i, "edge controls", 0)
                controls = np.vstack([shared[:, chosen], controls, shared[:, chosen + 1]])
            widths = np.diff(fractions)[chosen]
            repeated = [np.repeat(a, len(chosen), axis=1) for a in (at(i, "duration", 0), p)]
            variables = np.vstack(
                [
                    *(edges[:, chosen], at(i, "interior", d), edges[:, chosen + 1], controls),
                    *(at(i, "slacks", d), *repeated),
                ]
            )
            places = fractions[chosen] + widths * scheme.nodes[:, None]  # (n, elements)
            kind = "differential equation"
            rows = [self._rows(kind, i, phase.states, places[-len(scheme.D) :], d)]
            if phase.path:
                where = places[path_nodes(scheme)]
                rows.append(self._rows("path constraint", i, phase.path.names, where, d))
            if phase.powers:
                names = tuple(f"power {k}" for k in range(powers(phase)))
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
        at = self.layout.indices
        source, target = self.problem.phases[link.source], self.problem.phases[link.target]
        before, after = at(link.source, "edges", 0)[:, -1], at(link.target, "edges", 0)[:, 0]
        names = tuple(f"{n} from {source.name!r}" for n in target.states)

        def gap(x: ca.SX, y: ca.SX, p: ca.SX) -> ca.SX:
            return y - link.map(x, p)

        rows = self._rows("linkage", link.target, names, _START)
        return _once(gap, (before, after, at(-1, "parameters", 0)[:, 0]), rows)

    def _whole(self) -> Iterator[Block]:
        """What concerns all phases: their total duration, the boundary, the endpoint cost."""
        problem, at = self.problem, self.layout.indices
        phases = range(len(problem.phases))
        durations = np.concatenate([at(i, "duration", 0)[:, 0] for i in phases])
        rows = self._rows("total duration", -1, ("",), _START)
        yield _once(ca.sum1, (durations,), rows)
        starts = np.concatenate([at(i, "edges", 0)[:, 0] for i in phases])
        ends = np.concatenate([at(i, "edges", 0)[:, -1] for i in phases])
        everything = starts, ends, durations, at(-1, "parameters", 0)[:, 0]
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

    # -- bounds -------------------------------------------------------------------------------

    def bounds(self, problem: Problem) -> tuple[Array, Array]:
        """(lower, upper) of g, for a problem with the same functions."""
        links = iter(problem.linkages)
        parts = [_row_bounds(rows, problem, links) for rows in self.rows]
        lower, upper = (np.concatenate(side) for side in zip(*parts, strict=True))
        return lower, upper


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
    constraint = _constraint(rows, problem)
    times = rows.count // len(rows.names)
    return np.tile(constraint.lower, times), np.tile(constraint.upper, times)


def _constraint(rows: Rows, problem: Problem) -> Constraint:
    if rows.kind == "boundary":
        found = problem.boundary
    else:
        phase = problem.phases[rows.phase]
        found = {
            "path constraint": phase.path,
            "integral": phase.integral,
            "start constraint": phase.at_start,
            "end constraint": phase.at_end,
        }[rows.kind]
    assert found is not None  # the rows were made from it
    return found
