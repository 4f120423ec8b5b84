"""A problem on a mesh as a nonlinear program, built once and solved by IPOPT from many guesses."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import require_kind
from trajopt.ocp.pose.bounds import pair
from trajopt.ocp.pose.problem import Array, Constraint, Linkage, Problem
from trajopt.ocp.solving.interrupted import heeded
from trajopt.ocp.transcribe.element import element, path_nodes, powers
from trajopt.ocp.transcribe.layout import Group, Layout, groups
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.options import IPOPT, QUIET, require_options
from trajopt.ocp.transcribe.packing import pack, unpack
from trajopt.ocp.transcribe.program import Block, assembled
from trajopt.ocp.transcribe.rows import Breach, Rows, breaches
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: How IPOPT ends where the cost falls without bound.
DIVERGING = "Diverging_Iterates"

#: How IPOPT ends after Ctrl-C, which CasADi catches and reports in no other way.
INTERRUPTED = ("NonIpopt_Exception_Thrown", "User_Requested_Stop")


@dataclasses.dataclass(frozen=True)
class Result:
    """What IPOPT returned.

    Attributes:
        phases: the trajectory, phase by phase.
        parameters: the static parameters.
        cost: the objective, as the transcription sees it.
        success: IPOPT's verdict.
        status: IPOPT's words for it.
        iterations: of IPOPT.
        may_be_saddle: whether there is no sign of a minimum: IPOPT never moved, or met negative
            curvature in its last step.
        breaches: the most violated constraints, worst first, none below 1e-9.
        unknowns: of the program.
        multipliers: of its constraints; the Lagrangian is cost + multipliers . constraints.
        bound_multipliers: of the bounds on its unknowns, likewise.
    """

    phases: tuple[PhaseTrajectory, ...]
    parameters: Array
    cost: float
    success: bool
    status: str
    iterations: int
    may_be_saddle: bool
    breaches: tuple[Breach, ...]
    unknowns: Array = dataclasses.field(repr=False)
    multipliers: Array = dataclasses.field(repr=False)
    bound_multipliers: Array = dataclasses.field(repr=False)

    @property
    def worst(self) -> str:
        """The constraint that is violated most, in words."""
        return str(self.breaches[0]) if self.breaches else "no constraint violated"


class Transcription:
    """`problem` on `mesh` as a nonlinear program.

    All bounds, offsets and floors are data of `solve`, so that one transcription serves whatever
    differs in numbers alone: speeds, windings, limits, values of fixed parameters.
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        require_kind("problem", problem, Problem)
        require_kind("mesh", mesh, Mesh)
        if len(mesh.degrees) != len(problem.phases):
            raise ValueError(
                f"the mesh has {len(mesh.degrees)} phases, the problem {len(problem.phases)}: "
                "make it with Mesh.uniform(problem, ...)"
            )
        _require_inequalities(problem, mesh)
        self.problem, self.mesh = problem, mesh
        self.layout = Layout(problem, mesh)
        self.rows: list[Rows] = []
        self.element_blocks: list[tuple[tuple[int, Group], Block]] = []
        self.blocks = tuple(self._build())
        count = sum(rows.count for rows in self.rows)
        self._nlp, self._derivatives = assembled(self.blocks, self.layout.size, count)
        self._solvers: dict[Any, ca.Function] = {}

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> Iterator[Block]:
        problem, at = self.problem, self.layout.indices
        p = at(-1, "parameters", 0)
        for i in range(len(problem.phases)):
            yield from self._build_phase(i)
        for link in problem.linkages:
            source, target = problem.phases[link.source], problem.phases[link.target]
            before, after = at(link.source, "edges", 0)[:, -1], at(link.target, "edges", 0)[:, 0]
            names = tuple(f"{n} from {source.name!r}" for n in target.states)
            each = (before, after, p[:, 0])

            def gap(x: ca.SX, y: ca.SX, p: ca.SX, link: Linkage = link) -> ca.SX:
                return y - link.map(x, p)

            rows = self._rows("linkage", link.target, names, np.zeros(1))
            yield _once(gap, each, rows)
        counted = range(len(problem.phases))
        durations = np.concatenate([at(i, "duration", 0)[:, 0] for i in counted])
        rows = self._rows("total duration", -1, ("",), np.zeros(1))
        yield _once(ca.sum1, (durations,), rows)
        everything = (
            np.concatenate([at(i, "edges", 0)[:, 0] for i in counted]),
            np.concatenate([at(i, "edges", 0)[:, -1] for i in counted]),
            durations,
            p[:, 0],
        )
        if problem.boundary is not None:
            rows = self._rows("boundary", -1, problem.boundary.names, np.zeros(1))
            yield _once(problem.boundary.function, everything, rows)
        if problem.endpoint_cost is not None:
            yield _once(problem.endpoint_cost, everything, None)

    def _build_phase(self, i: int) -> Iterator[Block]:
        phase, fractions = self.problem.phases[i], np.array(self.mesh.fractions[i])
        at, zero, one = self.layout.indices, np.zeros(1), np.ones(1)
        edges, p = at(i, "edges", 0), at(-1, "parameters", 0)
        totals = self._rows("integral", i, phase.integral.names, zero) if phase.integral else None
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
            self.element_blocks.append(((i, group), block))
            yield block
            if scheme.shared_controls and phase.path:
                rows_here = self._rows("path constraint", i, phase.path.names, one)
                last = edges[:, -1], shared[:, -1], p[:, 0]
                yield _once(phase.path.function, last, rows_here)
        for kind, constraint, column in (
            ("start constraint", phase.at_start, 0),
            ("end constraint", phase.at_end, -1),
        ):
            if constraint:
                rows_here = self._rows(kind, i, constraint.names, one if column else zero)
                x = edges[:, column]
                yield _once(constraint.function, (x, p[:, 0]), rows_here)

    def _rows(
        self, kind: str, phase: int, names: Sequence[str], fractions: Array, degree: int = 0
    ) -> NDArray[np.intp]:
        """New rows of g, shape (names x places, elements); `fractions` (places, elements)."""
        table = np.atleast_1d(fractions).reshape(len(fractions), -1)
        count = len(names) * table.size
        first = sum(rows.count for rows in self.rows)
        self.rows.append(Rows(kind, phase, tuple(names), table.ravel(order="F"), degree, count))
        shape = (len(names) * len(table), table.shape[1])
        return np.arange(first, first + count).reshape(shape, order="F")

    # -- data ---------------------------------------------------------------------------------

    def bounds(self, problem: Problem) -> tuple[Array, Array]:
        """(lower, upper) of the constraints."""
        links = iter(problem.linkages)
        parts = [self._row_bounds(rows, problem, links) for rows in self.rows]
        return tuple(np.concatenate([part[side] for part in parts]) for side in (0, 1))  # type: ignore[return-value]

    def _row_bounds(self, rows: Rows, problem: Problem, links: Any) -> tuple[Array, Array]:
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
        constraint = self._constraint(rows, problem)
        times = rows.count // len(rows.names)
        return np.tile(constraint.lower, times), np.tile(constraint.upper, times)

    def _constraint(self, rows: Rows, problem: Problem) -> Constraint:
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

    def multipliers_of(self, result: Result) -> Iterator[tuple[Rows, Array]]:
        """Every kind of constraint and its multipliers."""
        cuts = np.cumsum([rows.count for rows in self.rows])
        yield from zip(self.rows, np.split(result.multipliers, cuts[:-1]), strict=True)

    # -- solving ------------------------------------------------------------------------------

    def posed(self, problem: Problem) -> Transcription:
        """This transcription of another problem, which differs in numbers alone.

        Raises:
            ValueError: it differs in more.
        """
        if problem is self.problem:
            return self
        if problem.functions != self.problem.functions:
            raise ValueError("the problem differs from the one transcribed in more than numbers")
        twin = copy.copy(self)
        twin.problem = problem
        return twin

    def solver(self, **options: Any) -> ca.Function:
        """IPOPT on this program, with options over `trajopt.ocp.transcribe.options.IPOPT`."""
        require_options(options)
        key = tuple(sorted(options.items()))
        if key not in self._solvers:
            settings = self._derivatives | {"ipopt": IPOPT | options, **QUIET}
            self._solvers[key] = ca.nlpsol("nlp", "ipopt", self._nlp, settings)
        return self._solvers[key]

    @heeded()
    def solve(
        self,
        guess: Sequence[PhaseTrajectory],
        problem: Problem | None = None,
        parameters: Array | None = None,
        **options: Any,
    ) -> Result:
        """A local optimum near `guess`.

        Args:
            guess: one trajectory per phase, on any mesh.
            problem: one that differs in numbers from the one transcribed.
            parameters: guess of the static parameters; by default the middle of their bounds.
            options: of IPOPT, over `trajopt.ocp.transcribe.options.IPOPT`.

        Raises:
            TypeError: the guess or an option is of the wrong kind.
            ValueError: `problem` differs in more than numbers, the guess does not fit it or is not
                finite, or IPOPT has no such option.
            KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        """
        problem = self.posed(problem or self.problem).problem
        lower, upper = self.layout.bounds(problem)
        start = np.clip(pack(self.layout, problem, guess, parameters), lower, upper)
        if not np.isfinite(start).all():
            raise ValueError("guess: its states, controls and parameters must all be finite")
        bounds = self.bounds(problem)
        solver = self.solver(**options)
        found = solver(x0=start, lbx=lower, ubx=upper, lbg=bounds[0], ubg=bounds[1])
        stats = solver.stats()
        if stats["return_status"] in INTERRUPTED:
            raise KeyboardInterrupt
        if stats["return_status"] == "Invalid_Option":
            raise ValueError(
                f"{options}: this build of IPOPT does not support these options; leave out "
                "linear_solver and others that need further libraries"
            )
        w = np.asarray(found["x"]).ravel()
        phases, values = unpack(self.layout, w), np.asarray(found["g"]).ravel()
        outside = np.maximum(np.maximum(bounds[0] - values, values - bounds[1]), 0.0)
        outside = np.nan_to_num(outside, nan=np.inf)
        return Result(
            phases=phases,
            parameters=self.layout.split(w)[-1, "parameters", 0].ravel(),
            cost=float(found["f"]),
            success=bool(stats["success"]),
            status=str(stats["return_status"]),
            iterations=int(stats["iter_count"]),
            may_be_saddle=stats["iter_count"] == 0 or _curved_down(stats),
            breaches=breaches(self.rows, outside, phases, problem),
            unknowns=w,
            multipliers=np.asarray(found["lam_g"]).ravel(),
            bound_multipliers=np.asarray(found["lam_x"]).ravel(),
        )


def _curved_down(stats: dict[str, Any]) -> bool:
    """Whether IPOPT had to make the Hessian of its last step convex."""
    added = stats.get("iterations", {}).get("regularization_size", [])
    return bool(added) and added[-1] > 0.0


def _require_inequalities(problem: Problem, mesh: Mesh) -> None:
    for phase in problem.phases:
        path = phase.path
        if mesh.scheme == "radau" and path is not None and np.any(path.lower == path.upper):
            name = path.names[int(np.argmax(path.lower == path.upper))]
            raise ValueError(
                f"path constraint {name!r} of phase {phase.name!r} is an equation: radau imposes "
                "it at more places than its controls have freedoms; solve it for a control, or "
                "use another scheme"
            )


def _once(function: Any, variables: Sequence[NDArray[np.intp]], rows: Any) -> Block:
    """A block that is applied once: constraints, or a cost where there are no rows."""
    v = ca.SX.sym("v", sum(map(len, variables)))
    value = function(*ca.vertsplit(v, np.cumsum([0, *map(len, variables)]).tolist()))
    outputs, cost = (value, ca.SX(0)) if rows is not None else (ca.SX(0, 1), value)
    traced = ca.Function("once", [v, ca.SX.sym("d", 0)], [ca.densify(outputs), cost])
    where = np.empty((0, 1), dtype=np.intp) if rows is None else rows
    return Block(traced, np.concatenate(variables)[:, None], where, np.empty((0, 1)))
