"""How accurate a solution on a mesh is: errors between the nodes, costates and Hamiltonian.

The costate at an element's edge is the derivative of the remaining cost with respect to the state
there; it is computed from the next element's Lagrangian. At an optimum the Hamiltonian, running
cost + costate . flow, is constant along every phase, because nothing depends on time explicitly. It
equals the price of the phase's duration: the derivative of the phase's least cost with respect to
it. (A bounded integral counts as a running cost, priced at its multiplier.) Both hold for the
continuous problem; how well they hold on a mesh tells how good the mesh is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.integrate import DOP853

from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import NOTEWORTHY, Violation
from trajopt.ocp.layout import evaluated, running_cost
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.scaling import PhaseScales, Scales, scales_of
from trajopt.ocp.schemes import full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Result, Transcription

#: By how much refining the mesh may raise the cost of one and the same optimum (relative).
SAME_COST = 5e-3

#: Points of the dense grid on an element, less one, and the grid itself: Chebyshev points. A
#: polynomial of degree 12 is nowhere more than 1.42 times as large as its largest value at 25 of
#: them (Ehlich and Zeller, 1964). Evenly spread points miss what happens close to the edges.
SAMPLES = 24
GRID = 0.5 - 0.5 * np.cos(np.pi * np.arange(SAMPLES + 1) / SAMPLES)

#: Steps of the 8th-order integrator per element.
STEPS = 2


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """What was solved and its solution, measured when it is first asked for a measure."""

    transcription: Transcription
    result: Result

    @cached_property
    def scales(self) -> Scales:
        """The scales along the solution, to which errors are relative."""
        result = self.result
        return scales_of(self.transcription.problem, result.phases, result.parameters)

    @cached_property
    def certificate(self) -> Certificate:
        """Costates and Hamiltonian."""
        return certificate(self.transcription, self.result, self.scales)

    @cached_property
    def qualities(self) -> tuple[Quality, ...]:
        """The errors of every phase."""
        result = self.result
        gaps = self.certificate.cost_gaps(result.phases, result.cost)
        errors = cost_errors(self.transcription, result, self.scales)
        phases = self.transcription.problem.phases
        each = zip(phases, result.phases, self.scales.phases, errors, gaps, strict=True)
        return tuple(
            assess(phase, trajectory, result.parameters, scales, error, gap)
            for phase, trajectory, scales, error, gap in each
        )

    @property
    def error(self) -> float:
        """Largest error of the states within an element; see `Quality.state_error`."""
        return float(max(quality.state_error.max() for quality in self.qualities))

    @property
    def overshoot(self) -> float:
        """Largest violation of a path constraint between the nodes, relative."""
        return float(max(quality.path_violation.max() for quality in self.qualities))

    def costs_more_than(self, other: Candidate) -> bool:
        """Whether it costs so much more that it must be another optimum."""
        cost = other.result.cost
        return self.result.cost - cost > SAME_COST * max(abs(cost), 1e-9 * self.scales.cost)


@dataclasses.dataclass(frozen=True)
class Quality:
    """The errors of a phase, element by element, between the nodes of its mesh.

    Errors of states are relative to the scale of the state + its largest magnitude in the phase,
    violations to the scale of what is violated.

    Attributes:
        defect_error: the largest magnitude of the residual x' - flow(x, u), integrated from the
            element's left edge, shape (M,).
        step_error: difference at the right edge to an explicit 8th-order integration from the left
            edge under the element's own control, shape (M,).
        limit_violation: largest violation of a bound on a state or control, shape (M,).
        path_violation: largest violation of each path constraint, shape (M, m).
        cost_error: error of the program's quadrature of costs and integrals, relative to the
            scale + the magnitude of the whole, shape (M,).
        cost_gap: what the control may cost too much, see `Certificate.cost_gaps`, shape (M,).
    """

    defect_error: Array
    step_error: Array
    limit_violation: Array
    path_violation: Array
    cost_error: Array
    cost_gap: Array

    @property
    def state_error(self) -> Array:
        """The larger of `defect_error` and `step_error`, shape (M,)."""
        return np.maximum(self.defect_error, self.step_error)


def assess(
    phase: Phase,
    trajectory: PhaseTrajectory,
    p: Array,
    scales: PhaseScales,
    cost_error: Array | float = 0.0,
    cost_gap: Array | float = 0.0,
) -> Quality:
    """Measure a phase on a dense grid within its elements; the costs' errors are known."""
    states, rates, controls = _dense(trajectory)
    scale = scales.states + np.abs(states).max(axis=(0, 1))
    flow = evaluated(phase.flow, states, controls, p)
    residual = rates - trajectory.element_durations[:, None, None] * flow
    trapezia = 0.5 * (residual[:, 1:] + residual[:, :-1]) * np.diff(GRID)[:, None]
    integral = np.cumsum(trapezia, axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        step = np.nan_to_num(stepped(phase, trajectory, p) - trajectory.states[:, -1], nan=np.inf)
    (_, _, of_states), (_, _, of_controls), *paths = _limits(phase, trajectory, p, scales)
    path = paths[0][2].max(axis=1) if paths else np.zeros((len(states), 1))
    outside = np.concatenate([of_states, of_controls], axis=-1)
    return Quality(
        (np.abs(integral) / scale).max(axis=(1, 2)),
        (np.abs(step) / scale).max(axis=1),
        np.maximum(outside, 0.0).max(axis=(1, 2)),
        path,
        cost_error + np.zeros(len(states)),
        cost_gap + np.zeros(len(states)),
    )


def cost_errors(transcription: Transcription, result: Result, scales: Scales) -> list[Array]:
    """The program's quadrature compared with a finer one: `Quality.cost_error` of every phase."""
    problem, p = transcription.problem, result.parameters
    integrals = [_integrals(*each, p) for each in zip(problem.phases, result.phases, strict=True)]
    scale = []
    for values, each in zip(integrals, scales.phases, strict=True):
        scale.append(np.r_[scales.cost, each.integral] + np.abs(values.sum(axis=0)))
        scale[-1][0] = scales.cost + abs(result.cost)
    for each in transcription.equations.element_blocks:
        block, errors = each.block, integrals[each.phase]
        mapped = block.function.map(block.count)
        outputs, cost = mapped(result.unknowns[block.variables], block.data)
        quadrature = outputs.full()[len(block.rows) - (errors.shape[1] - 1) :]
        errors[each.group.elements] -= np.vstack([cost.full(), quadrature]).T
    return [(np.abs(v) / s).max(axis=1) for v, s in zip(integrals, scale, strict=True)]


def _integrals(phase: Phase, trajectory: PhaseTrajectory, p: Array) -> Array:
    """Integrals over every element, of the running cost and the m integrands: (M, 1 + m)."""
    s, weights = np.polynomial.legendre.leggauss(SAMPLES)
    x = lagrange_matrix(trajectory.nodes, 0.5 + 0.5 * s) @ trajectory.states
    u = lagrange_matrix(trajectory.control_nodes, 0.5 + 0.5 * s) @ trajectory.controls
    rates = running_cost(phase, x, u, p)[..., None]
    if phase.integral is not None:
        rates = np.concatenate([rates, evaluated(phase.integral.function, x, u, p)], axis=-1)
    h = trajectory.element_durations[:, None]
    return np.asarray(h * np.einsum("s,esm->em", 0.5 * weights, rates))


def stepped(phase: Phase, trajectory: PhaseTrajectory, p: Array) -> Array:
    """States (M, nx) at the elements' right edges, integrated from their left edges.

    They may be infinite or NaN on long stiff elements, where an explicit method fails.
    """
    y, h = trajectory.states[:, 0], trajectory.element_durations[:, None] / STEPS
    for step in range(STEPS):
        rates: list[Array] = []
        for i, row in enumerate(DOP853.A):
            x = y + h * sum((a * f for a, f in zip(row, rates, strict=False)), start=0.0 * y)
            s = (step + DOP853.C[i]) / STEPS
            basis = lagrange_matrix(trajectory.control_nodes, np.array([s]))[0]
            u = np.einsum("m,emu->eu", basis, trajectory.controls)
            rates.append(evaluated(phase.flow, x, u, p))
        y = y + h * sum((b * f for b, f in zip(DOP853.B, rates, strict=True)), start=0.0 * y)
    return y


def beyond(values: Array, lower: Array, upper: Array) -> Array:
    """How far values (..., m) are outside bounds (m,); negative inside."""
    return np.asarray(np.maximum(lower - values, values - upper))


def _limits(
    phase: Phase, trajectory: PhaseTrajectory, p: Array, scales: PhaseScales
) -> list[tuple[str, dict[str, float], Array]]:
    """Kind, scales of m names, and relative excesses (M, samples, m): states, controls, path.

    States are allowed what their ends, which have bounds of their own, are outside those all along.
    """
    states, _, controls = _dense(trajectory)
    ends = np.stack([trajectory.start, trajectory.end])
    at_ends = np.maximum(beyond(ends, *phase.state_bounds()), 0.0).max(axis=0)
    limits = [
        ("bound", phase.states, scales.states, beyond(states, *phase.state_bounds()) - at_ends),
        ("bound", phase.controls, scales.controls, beyond(controls, *phase.control_bounds())),
    ]
    if phase.path is not None:
        excess = phase.path.violation(evaluated(phase.path.function, states, controls, p))
        limits.append(("path constraint", phase.path.names, scales.path, excess))
    return [
        (kind, dict(zip(names, units.tolist(), strict=True)), excess / units)
        for kind, names, units, excess in limits
    ]


def _dense(trajectory: PhaseTrajectory) -> tuple[Array, Array, Array]:
    """States, their derivatives with respect to the fraction of the element, and controls.

    All on the dense grid, of shapes (M, samples, .).
    """
    basis = lagrange_matrix(trajectory.nodes, GRID)
    slope = basis @ full_differentiation_matrix(tuple(trajectory.nodes))
    controls = lagrange_matrix(trajectory.control_nodes, GRID) @ trajectory.controls
    return basis @ trajectory.states, slope @ trajectory.states, controls


def audit(
    problem: Problem, phases: Sequence[PhaseTrajectory], p: Array, scales: Scales
) -> tuple[Violation, ...]:
    """The worst violation of every limit that is violated between the nodes, worst first."""
    violations: list[Violation] = []
    for phase, trajectory, each in zip(problem.phases, phases, scales.phases, strict=True):
        times = trajectory.edges[:-1, None] + trajectory.element_durations[:, None] * GRID
        for kind, units, outside in _limits(phase, trajectory, p, each):
            for (name, unit), excess in zip(
                units.items(), np.moveaxis(outside, -1, 0), strict=True
            ):
                worst = np.unravel_index(np.argmax(excess), excess.shape)
                relative = float(excess[worst])
                if relative > NOTEWORTHY:
                    amounts = float(times[worst]), unit * relative, relative
                    violations.append(Violation(kind, name, phase.name, *amounts))
    return tuple(sorted(violations, key=lambda violation: -violation.relative))


# -- costates and Hamiltonian -------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Certificate:
    """First-order optimality, phase by phase.

    Attributes:
        costates: at the elements' edges, shape (M + 1, nx) each; cost per unit of the state.
        hamiltonian: at both ends of every element, shape (M, 2) each.
        mean_hamiltonian: of every element in the program: the derivative of the least cost with
            respect to the element's duration, shape (M,) each.
        duration_price: the same with respect to each phase's duration, shape (phases,).
        cost_scale: what counts as one of the cost.
        scales: the same of the Hamiltonian, shape (phases,): of the cost over the duration.
    """

    costates: tuple[Array, ...]
    hamiltonian: tuple[Array, ...]
    mean_hamiltonian: tuple[Array, ...]
    duration_price: Array
    cost_scale: float
    scales: Array

    @property
    def hamiltonian_spread(self) -> float:
        """Largest deviation from its mean over a phase, relative to scale + largest magnitude."""
        pairs = zip(self.hamiltonian, self.scales, strict=True)
        return float(max(np.abs(h - h.mean()).max() / (s + np.abs(h).max()) for h, s in pairs))

    @property
    def transversality_error(self) -> float:
        """Largest gap between the mean Hamiltonian and the price of duration, likewise relative."""
        each = zip(self.hamiltonian, self.duration_price, self.scales, strict=True)
        return float(max(abs(h.mean() - price) / (s + abs(price)) for h, price, s in each))

    def cost_gaps(self, phases: Sequence[PhaseTrajectory], cost: float) -> tuple[Array, ...]:
        """What each element may cost too much, relative to its scale + |cost|, (M,) per phase.

        Where the control is not optimal, for example because the optimal one switches within the
        element, the Hamiltonian varies. Its variation times the element's duration is a cost.
        """
        gaps = []
        for ends, mean, phase in zip(self.hamiltonian, self.mean_hamiltonian, phases, strict=True):
            all_three = np.column_stack([ends, mean])
            gaps.append(np.ptp(all_three, axis=1) * phase.element_durations)
        return tuple(gap / (self.cost_scale + abs(cost)) for gap in gaps)


def certificate(transcription: Transcription, result: Result, scales: Scales) -> Certificate:
    """Costates and Hamiltonian of a solution from its multipliers."""
    problem = transcription.problem
    means = [np.zeros(len(t.edges) - 1) for t in result.phases]
    costates = [np.zeros((len(t.edges), t.states.shape[-1])) for t in result.phases]
    for each in transcription.equations.element_blocks:
        index, group, block = each.phase, each.group, each.block
        v, d = block.function.sx_in()
        outputs, cost = block.function(v, d)
        mu = ca.SX.sym("mu", outputs.numel())
        gradient = ca.Function("g", [v, d, mu], [ca.gradient(cost + ca.dot(mu, outputs), v)])
        values = np.asarray(
            gradient.map(block.count)(
                result.unknowns[block.variables], block.data, result.multipliers[block.rows]
            )
        )
        nx, n = len(problem.phases[index].states), len(group.scheme.nodes)
        costates[index][group.elements] = values[:nx].T
        if group.elements[-1] == len(costates[index]) - 2:
            right = nx * (n - 1)
            costates[index][-1] = -values[right : right + nx, -1]
        means[index][group.elements] = values[-1 - len(result.parameters)] / block.data[0]
    prices = {(rows.kind, rows.phase): mu for rows, mu in transcription.multipliers_of(result)}
    hamiltonians = [
        hamiltonian(phase, trajectory, costates[i], result.parameters, prices.get(("integral", i)))
        for i, (phase, trajectory) in enumerate(zip(problem.phases, result.phases, strict=True))
    ]
    widths = [t.element_durations / t.duration for t in result.phases]
    price = np.array([mean @ width for mean, width in zip(means, widths, strict=True)])
    return Certificate(
        costates=tuple(costates),
        hamiltonian=tuple(hamiltonians),
        mean_hamiltonian=tuple(means),
        duration_price=price,
        cost_scale=scales.cost,
        scales=scales.cost / np.array([each.duration for each in scales.phases]),
    )


def hamiltonian(
    phase: Phase,
    trajectory: PhaseTrajectory,
    costates: Array,
    p: Array,
    prices: Array | None = None,
) -> Array:
    """The Hamiltonian at both ends of every element, shape (M, 2).

    The costates are those at the elements' edges, the multipliers those of bounded integrals.
    """
    x, u = trajectory.states[:, [0, -1]], trajectory.controls[:, [0, -1]]
    rates = np.stack([costates[:-1], costates[1:]], axis=1)
    value = np.einsum("esx,esx->es", rates, evaluated(phase.flow, x, u, p))
    if phase.integral is not None and prices is not None:
        value = value + evaluated(phase.integral.function, x, u, p) @ prices
    return np.asarray(value + running_cost(phase, x, u, p))
