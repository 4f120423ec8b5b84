"""A solved problem, as users see it: states and controls by time, whether it converged, its file.

A file has everything but the problem, whose functions are not plain data. `Extremal.load` is
therefore given the problem; `load_phases` needs none.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import real_array
from trajopt.ocp.arrays import Array
from trajopt.ocp.certificate import Certificate
from trajopt.ocp.constraints import Violation, pair
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.pontryagin import PLACES, View
from trajopt.ocp.problem import Problem
from trajopt.ocp.resimulation import Resimulation
from trajopt.ocp.scaling import Scales, scales_of
from trajopt.ocp.trajectory import SAME_TIME, PhaseTrajectory, require_side
from trajopt.ocp.transcription import DIVERGING
from trajopt.store import joined, provenance, read_arrays, split, write_arrays

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: How far simulated states may be off, relative to the tolerance of the mesh.
RESIMULATION_FACTOR = 100.0

#: How far the cost of a solution may be from the least, relative to the scale + |cost|.
SUBOPTIMAL = 1e-4

#: Simulated states that are off by more than this, relative to their scales, mean nothing.
MEANINGLESS = 0.1

#: IPOPT's status for a success, and where it finds no way to satisfy all constraints.
SUCCESS, INFEASIBLE = "Solve_Succeeded", "Infeasible_Problem_Detected"

#: Numbers of one problem differ by less than this (relative) on all processors.
SAME_NUMBERS = 1e-9

#: Functions of two problems are compared at so many places so far from a solution, relative to its
#: scales: not on it, where equations that it satisfies leave nothing but rounding.
SAMPLES, RADII = 8, (0.01, 0.1, 1.0, 10.0)

FORMAT = "trajopt extremal 7"

REMEDY = "copy it again, or solve its problem again"


class ExtremalFileError(ValueError):
    """A file is no solution saved by this version, is damaged, or belongs to another problem."""


@dataclasses.dataclass(frozen=True)
class Attempt:
    """One run of IPOPT.

    Attributes:
        elements: of the mesh, in all phases together.
        options: of IPOPT.
        status: IPOPT's name for how the run ended.
        iterations: that it took.
    """

    elements: int
    options: dict[str, Any]
    status: str
    iterations: int

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT succeeded."""
        return self.status == SUCCESS


@dataclasses.dataclass(frozen=True, repr=False)
class Extremal:
    """A trajectory that satisfies the first-order conditions of optimality, or the nearest miss.

    Attributes:
        problem: what was solved.
        mesh: the best one, on which the solution is given.
        phases: the trajectory, phase by phase.
        parameters: values of the static parameters, shape (np,).
        tolerance: the limit of `mesh_error`.
        limit_tolerance: of violations between the nodes.
        transcribed_cost: the objective of the nonlinear program.
        mesh_error: largest estimated relative error of the states within an element.
        status: IPOPT's name for how the run on `mesh` ended.
        attempts: every run of IPOPT, in order; the last may be on a mesh that was given up.
        violations: constraints that the program's solution violates, worst first.
        audit: limits that are violated between the nodes, worst first.
        certificate: costates and Hamiltonian.
        resimulation: the forward simulation; None if `solve` was called with ``verify=False``, or
            the cost has no minimum, or a function is not finite.
        provenance: versions and git revision.
    """

    problem: Problem
    mesh: Mesh
    phases: tuple[PhaseTrajectory, ...]
    parameters: Array
    tolerance: float
    limit_tolerance: float
    transcribed_cost: float
    mesh_error: float
    status: str
    attempts: tuple[Attempt, ...]
    violations: tuple[Violation, ...]
    audit: tuple[Violation, ...]
    certificate: Certificate
    resimulation: Resimulation | None
    provenance: dict[str, Any] = dataclasses.field(default_factory=provenance)

    @property
    def cost(self) -> float:
        """The objective along the forward simulation, or else `transcribed_cost`.

        A simulation that leaves the solution far behind has a cost without meaning.
        """
        simulated = self.resimulation
        if simulated is None or not max(simulated.phase_errors) < MEANINGLESS:
            return self.transcribed_cost
        return simulated.cost

    @cached_property
    def scales(self) -> Scales:
        """What counts as one of every quantity; errors are relative to these."""
        return scales_of(self.problem, self.phases, self.parameters)

    @property
    def duration(self) -> float:
        """Sum of the phases' durations (s)."""
        return float(self._ends[-1])

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT solved the program on the mesh; that is no measure of accuracy."""
        return self.status == SUCCESS

    @property
    def converged(self) -> bool:
        """Whether nothing is wrong.

        That is: IPOPT succeeded, the mesh is fine enough, limits hold, the forward simulation
        agrees with the solution, and the cost is close to the least by `Certificate.suboptimality`.
        """
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """What is wrong, in words; empty if the solution converged."""
        failures = []
        if not self.succeeded:
            others = " from this guess; `multi_start` tries others"
            hint = others if self.status == INFEASIBLE else ""
            failures.append(f"IPOPT: {self.status}{hint}")
        if self.status == DIVERGING:
            failures.append("the cost has no minimum, or limits contradict each other")
        failures += [str(violation) for violation in self.violations[:3]]
        if not self.mesh_error <= self.tolerance:
            failures.append(f"mesh error {self.mesh_error:.1e} exceeds {self.tolerance:.1e}")
        failures += [
            f"between the nodes, {b}" for b in self.audit[:3] if b.relative > self.limit_tolerance
        ]
        if self.resimulation is not None:
            worst = max(self.resimulation.phase_errors)
            if not worst <= RESIMULATION_FACTOR * self.tolerance:
                failures.append(f"simulated, a phase is off by {worst:.1e} (relative)")
        excess = self.certificate.suboptimality / (self.scales.cost + abs(self.cost))
        if not excess <= SUBOPTIMAL:
            failures.append(f"the cost is about {excess:.1e} (relative) off the least")
        return tuple(failures)

    @property
    def outcome(self) -> str:
        """Whether the solution converged, or why not, in one line."""
        return "converged" if self.converged else "FAILED: " + "; ".join(self.failures)

    # -- by time --------------------------------------------------------------------------------

    def state(self, t: ArrayLike, side: str = "right") -> Array:
        """States at times t (s) from the start of the first phase, with phases in a row.

        Args:
            t: from 0 to `duration`, a scalar or of shape (N,). There is nothing outside: a solution
                is not periodic, as a gait is.
            side: "left" or "right", where one phase ends and the next begins.

        Returns:
            Shape (nx,) for a scalar, else (N, nx).

        Raises:
            TypeError: a time is not a real number.
            ValueError: a time or `side` is out of its range, or times lie in phases that have
                different numbers of states.
        """
        return self._read(t, side, lambda phase, local: phase.state(local))

    def control(self, t: ArrayLike, side: str = "right") -> Array:
        """Controls (nu,) or (N, nu) likewise; `side` matters wherever the control jumps."""
        return self._read(t, side, lambda phase, local: phase.control(local, side))

    @property
    def _ends(self) -> Array:
        """When each phase ends (s); unlike `sum`, the same to the bit on every Python."""
        return np.cumsum([phase.duration for phase in self.phases])

    def _read(
        self, t: ArrayLike, side: str, read: Callable[[PhaseTrajectory, Array], Array]
    ) -> Array:
        times = np.atleast_1d(real_array("t", t)).astype(float)
        require_side(side)
        ends = self._ends
        rounding = SAME_TIME * ends[-1]
        outside = ~((times >= -rounding) & (times <= ends[-1] + rounding))
        if times.ndim != 1 or outside.any():
            wrong = times[outside][0] if outside.any() else f"of shape {times.shape}"
            raise ValueError(f"t = {wrong}: must be from 0 to {ends[-1]} s, one time or a row")
        # Rounding must not decide on which side of a phase's end a time lies that is meant to be
        # on it.
        past = times + rounding if side == "right" else times - rounding
        where = np.minimum(np.searchsorted(ends, past), len(self.phases) - 1)
        parts = {
            i: read(self.phases[i], times[where == i] - begin)
            for i, begin in enumerate([0.0, *ends[:-1]])
            if (where == i).any()
        }
        if len({values.shape[1] for values in parts.values()}) > 1:
            raise ValueError("t: times in phases of different states or controls; read them apart")
        values = np.empty((len(times), *(v.shape[1] for v in list(parts.values())[:1])))
        for i, part in parts.items():
            values[where == i] = part
        return values if np.ndim(t) else values[0]

    # -- reports --------------------------------------------------------------------------------

    def __repr__(self) -> str:
        return f"Extremal(cost {self.cost:.6g}, {len(self.phases)} phase(s), {self.outcome})"

    def report(self) -> str:
        """Everything worth knowing, as text; failures in capitals."""
        elements = ", ".join(str(len(d)) for d in self.mesh.degrees)
        iterations = sum(a.iterations for a in self.attempts)
        certificate = self.certificate
        gap, control = certificate.suboptimality, sum(g.sum() for g in certificate.cost_gaps)
        lines = [
            f"Optimal control, {len(self.phases)} phase(s), {self.duration:.6g} s",
            f"  outcome              {self.outcome}",
            f"  cost                 {self.cost:.9g} (transcribed {self.transcribed_cost:.9g})",
            f"  mesh                 {self.mesh.scheme}, {elements} elements, "
            f"error {self.mesh_error:.1e}",
            f"  IPOPT                {len(self.attempts)} run(s), {iterations} iterations",
            f"  scales               {self._scales_in_words()}",
            f"  Hamiltonian          spread {certificate.hamiltonian_spread:.1e}, "
            f"transversality {certificate.transversality_error:.1e}",
            f"  suboptimality        about {gap:.1e}, of which the control {control:.1e}",
        ]
        if self.resimulation is not None:
            lines.append(
                f"  simulated            off by {max(self.resimulation.phase_errors):.1e} a phase, "
                f"{self.resimulation.chain_error:.1e} in all"
            )
            lines += [
                f"  unstable             errors grow by 1e{growth:.0f} in phase {phase.name!r}, "
                f"which is simulated in {spans} spans"
                for phase, spans, growth in zip(
                    *(self.problem.phases, self.resimulation.spans, self.resimulation.growth),
                    strict=True,
                )
                if spans > 1
            ]
        for name, value in zip(self.problem.parameters, self.parameters, strict=True):
            lines.append(f"  parameter            {name} = {value:.9g}")
        for phase, trajectory in zip(self.problem.phases, self.phases, strict=True):
            pairs = zip(phase.states, trajectory.end, strict=True)
            end = ", ".join(f"{name} {value:.6g}" for name, value in pairs)
            lines.append(f"  {phase.name:<20} {trajectory.duration:.6g} s, ends at {end}")
        lines += [f"  between the nodes    {violation}" for violation in self.audit[:5]]
        retried = [a for a in self.attempts if not a.succeeded]
        lines += [f"  retried              {a.status} with {a.options}" for a in retried]
        return "\n".join(lines)

    def _scales_in_words(self) -> str:
        """The scale of the cost, and those of each phase that differ from one."""
        parts = [f"cost {self.scales.cost:g}"]
        for phase, s in zip(self.problem.phases, self.scales.phases, strict=True):
            units = dict(zip(phase.states + phase.controls, [*s.states, *s.controls], strict=True))
            units = {"duration": s.duration} | units
            others = ", ".join(f"{name} {unit:g}" for name, unit in units.items() if unit != 1.0)
            parts += [f"{phase.name}: {others}"] if others else []
        return "; ".join(parts)

    def plot(self) -> Figure:
        """The solution by time: states and controls, and beside them what shows optimality.

        Beside a state is its costate, beside a control its switching function, the derivative of
        the Hamiltonian: where it is positive, less of the control would cost less. Thin lines are
        the mesh's edges, thick ones the ends of phases.
        """
        from matplotlib.figure import Figure  # takes half a second

        names = [list(each.states + each.controls) for each in self.problem.phases]
        every = list(dict.fromkeys(itertools.chain(*names)))
        figure = Figure((9.0, 1.6 * len(every)), layout="constrained")
        axes = figure.subplots(len(every), 2, sharex=True, squeeze=False)
        begins = [0.0, *self._ends[:-1]]
        for i, (phase, path) in enumerate(zip(self.problem.phases, self.phases, strict=True)):
            certificate = self.certificate
            costates, of_integrals = certificate.costates[i], certificate.integral_multipliers[i]
            view = View(phase, path, costates, self.parameters, of_integrals)
            inside = view.inside()
            x, u, slopes = inside.states, inside.controls, inside.costates()
            sides = np.dstack([x, u]), np.dstack([slopes, view.switching(x, u, slopes)])
            edges = begins[i] + path.edges
            times = edges[:-1, None] + path.element_durations[:, None] * PLACES
            for k, name in enumerate(names[i]):
                for axis, values in zip(axes[every.index(name)], sides, strict=True):
                    apart = np.full(len(times), np.nan)  # a gap between elements, where values jump
                    axis.plot(
                        np.column_stack([times, edges[1:]]).ravel(),
                        np.column_stack([values[..., k], apart]).ravel(),
                        color="C0",
                    )
            for axis in axes.flat:
                axis.vlines(edges, 0, 1, "0.8", lw=0.4, transform=axis.get_xaxis_transform())
                axis.axvline(edges[-1], color="0.6", lw=0.8)
        for name, (left, right) in zip(every, axes, strict=True):
            left.set_ylabel(name)
            state = any(name in phase.states for phase in self.problem.phases)
            right.set_ylabel(f"costate of {name}" if state else f"dH/d{name}")
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        return figure

    # -- files ----------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write everything but the problem to an .npz file.

        Raises:
            OSError: it cannot be written.
        """
        attributes = dataclasses.asdict(dataclasses.replace(self, problem=None))  # type: ignore[arg-type]
        arrays: dict[str, Any] = {}
        units = attributes["units"] = self.scales.flat
        attributes["numbers"] = _numbers(self.problem, self.phases, self.parameters, units)
        header = {"names": _names(self.problem), "attributes": split(attributes, arrays)}
        write_arrays(path, FORMAT, header, arrays)

    @classmethod
    def load(cls, path: str | Path, problem: Problem) -> Extremal:
        """Read what `save` wrote, a solution of `problem`.

        Raises:
            FileNotFoundError: there is no such file.
            ExtremalFileError: it is not a solution saved by this version, was edited or damaged,
                or `problem` is another one than was solved.
        """
        names, attributes = _read(path)
        phases, numbers = _phases(attributes), attributes.pop("numbers")
        units, p = attributes.pop("units"), attributes["parameters"]
        other = "names or constraints" if names != _names(problem) else ""
        if not other and not _same(numbers, _numbers(problem, phases, p, units)):
            other = "bounds, linkages or functions"
        if other:
            raise ExtremalFileError(
                f"{path}: the solution of another problem than the one given, which has other "
                f"{other}; `load_phases` reads it as a guess"
            )
        certificate, simulated = attributes["certificate"], attributes["resimulation"]
        made = {
            "problem": problem,
            "mesh": Mesh.from_dict(attributes["mesh"]),
            "phases": phases,
            "attempts": tuple(Attempt(**each) for each in attributes["attempts"]),
            "violations": tuple(Violation(**each) for each in attributes["violations"]),
            "audit": tuple(Violation(**each) for each in attributes["audit"]),
            "certificate": Certificate(**_with_tuples(certificate)),
            "resimulation": simulated and Resimulation(**_with_tuples(simulated)),
        }
        return cls(**{**attributes, **made})


def load_phases(path: str | Path) -> tuple[PhaseTrajectory, ...]:
    """The trajectory that `Extremal.save` wrote: a guess for any problem with such phases.

    Raises:
        FileNotFoundError: there is no such file.
        ExtremalFileError: it is not a solution saved by this version, or was edited or damaged.
    """
    return _phases(_read(path)[1])


def _read(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The names in a file, and the attributes of the solution as plain values and arrays."""
    header, arrays = read_arrays(path, FORMAT, ExtremalFileError, REMEDY)
    return header["names"], joined(header["attributes"], arrays)


def _phases(attributes: dict[str, Any]) -> tuple[PhaseTrajectory, ...]:
    return tuple(PhaseTrajectory(**phase) for phase in attributes["phases"])


def _with_tuples(values: dict[str, Any]) -> dict[str, Any]:
    """The values with tuples in place of the lists that a file has."""
    return {n: tuple(value) if isinstance(value, list) else value for n, value in values.items()}


def _names(problem: Problem) -> dict[str, Any]:
    """What a problem consists of, by name."""
    phases = [
        [phase.name, list(phase.states), list(phase.controls)]
        + [list(c.names) if c else None for c in phase.constraints]
        + [phase.cost is not None, phase.powers is not None]
        for phase in problem.phases
    ]
    return {
        "phases": phases,
        "linkages": [[link.source, link.target] for link in problem.linkages],
        "parameters": list(problem.parameters),
        "boundary": list(problem.boundary.names) if problem.boundary else None,
        "endpoint_cost": problem.endpoint_cost is not None,
    }


def _numbers(problem: Problem, phases: Sequence[PhaseTrajectory], p: Array, units: Array) -> Array:
    """All numbers of a problem, and what its functions return around a solution.

    Every row is one quantity at `SAMPLES` places; `units` are `Scales.flat`. Problems of the same
    names with the same numbers are the same, though traced elsewhere.
    """
    rng = np.random.default_rng(0)
    sizes = [n for each in problem.phases for n in (len(each.states), len(each.controls), 1)]
    *of_phases, of_p, _ = np.split(units, np.cumsum([*sizes, len(p)]))
    numbers: list[Any] = [pair(problem.duration), *map(pair, problem.parameters.values())]
    numbers += [problem.offset(link) for link in problem.linkages]
    if problem.boundary is not None:
        numbers += [problem.boundary.lower, problem.boundary.upper]
    for phase in problem.phases:
        numbers += [*phase.control_bounds(), pair(phase.duration), [phase.floor]]
        for end in ("all along", "start", "end"):
            numbers += phase.state_bounds(end)
        for constraint in filter(None, phase.constraints):
            numbers += [constraint.lower, constraint.upper]
    rows: list[Any] = [np.repeat(np.concatenate(numbers)[:, None], SAMPLES, axis=1)]
    for radius in RADII:

        def around(columns: Array, unit: Array, radius: float = radius) -> Array:
            directions = rng.uniform(-1.0, 1.0, (len(unit), SAMPLES))
            return np.asarray(columns + radius * unit[:, None] * directions)

        parameters, starts, ends, durations = around(p[:, None], of_p), [], [], []
        for i, (phase, path) in enumerate(zip(problem.phases, phases, strict=True)):
            of_x, of_u, of_duration = of_phases[3 * i : 3 * i + 3]
            times = path.duration * np.linspace(0.05, 0.95, SAMPLES)
            x, u = around(path.state(times).T, of_x), around(path.control(times).T, of_u)
            starts.append(around(path.start[:, None], of_x))
            ends.append(around(path.end[:, None], of_x))
            durations.append(around(np.array([[path.duration]]), of_duration))
            path_at, integrand, at_start, at_end = (c and c.function for c in phase.constraints)
            along = phase.flow, phase.cost, phase.powers, path_at, integrand
            calls: list[tuple[Any, Any]] = [(each, (x, u, parameters)) for each in along]
            calls += [(at_start, (starts[-1], parameters)), (at_end, (ends[-1], parameters))]
            rows += [function(*arguments) for function, arguments in calls if function]
        everything = *map(np.vstack, (starts, ends, durations)), parameters
        of_all = problem.endpoint_cost, problem.boundary and problem.boundary.function
        rows += [function(*everything) for function in of_all if function]
        rows += [link.map(ends[link.source], parameters) for link in problem.linkages]
    return np.vstack([np.asarray(each) for each in rows])


def _same(one: Array, other: Array) -> bool:
    """Whether two tables of `_numbers` differ by no more than rounding, relative to each row."""
    finite = np.where(np.isfinite(one), np.abs(one), 0.0)
    rounding = SAME_NUMBERS * finite.max(axis=1, keepdims=True)
    return one.shape == other.shape and bool(
        np.isclose(one, other, rtol=0.0, atol=rounding, equal_nan=True).all()
    )
