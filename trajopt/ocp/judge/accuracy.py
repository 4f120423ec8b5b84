"""Errors of a solution between its nodes: of the differential equation, the limits, the cost."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.integrate import DOP853

from trajopt.ocp.arrays import Array
from trajopt.ocp.judge.costates import running_cost
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.transcribe.nlp import Result, Transcription
from trajopt.ocp.transcribe.packing import evaluated
from trajopt.ocp.transcribe.rows import NOTEWORTHY, Breach
from trajopt.ocp.transcribe.schemes.polynomials import full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Points of the dense grid on an element, less one, and the grid itself: Chebyshev points. A
#: polynomial of degree 12 is nowhere more than 1.42 times as large as its largest value at 25 of
#: them (Ehlich and Zeller, 1964). Evenly spread points miss what happens close to the edges.
SAMPLES = 24
GRID = 0.5 - 0.5 * np.cos(np.pi * np.arange(SAMPLES + 1) / SAMPLES)

#: Steps of the 8th-order integrator per element.
STEPS = 2


@dataclasses.dataclass(frozen=True)
class Quality:
    """The errors of a phase, element by element, between the nodes of its mesh.

    Errors of states are relative to 1 + the largest magnitude of that state in the phase.

    Attributes:
        defect_error: the largest magnitude of the residual x' - flow(x, u), integrated from the
            element's left edge, shape (M,).
        step_error: difference at the right edge to an explicit 8th-order integration from the left
            edge under the element's own control, shape (M,).
        limit_violation: largest violation of a bound on a state or control, shape (M,).
        path_violation: largest violation of each path constraint, shape (M, m).
        cost_error: error of the program's quadrature of costs and integrals, relative to 1 + the
            magnitude of the whole, shape (M,).
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
    cost_error: Array | float = 0.0,
    cost_gap: Array | float = 0.0,
) -> Quality:
    """Measure a phase on a dense grid within its elements.

    Args:
        phase: whose motion it is.
        trajectory: of the phase.
        p: static parameters.
        cost_error: see `Quality`; measured by `cost_errors`.
        cost_gap: see `Quality`; measured by `Certificate.cost_gaps`.
    """
    states, rates, controls = _dense(trajectory)
    scale = 1.0 + np.abs(states).max(axis=(0, 1))
    flow = evaluated(phase.flow, states, controls, p)
    residual = rates - trajectory.element_durations[:, None, None] * flow
    trapezia = 0.5 * (residual[:, 1:] + residual[:, :-1]) * np.diff(GRID)[:, None]
    integral = np.cumsum(trapezia, axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        step = np.nan_to_num(stepped(phase, trajectory, p) - trajectory.states[:, -1], nan=np.inf)
    path = np.zeros((len(states), 1))
    if phase.path is not None:
        values = evaluated(phase.path.function, states, controls, p)
        path = phase.path.violation(values).max(axis=1)
    outside = np.concatenate(
        [
            beyond(states, *phase.state_bounds()) - _at_ends(phase, trajectory),
            beyond(controls, *phase.control_bounds()),
        ],
        axis=-1,
    )
    return Quality(
        (np.abs(integral) / scale).max(axis=(1, 2)),
        (np.abs(step) / scale).max(axis=1),
        np.maximum(outside, 0.0).max(axis=(1, 2)),
        path,
        cost_error + np.zeros(len(states)),
        cost_gap + np.zeros(len(states)),
    )


def cost_errors(transcription: Transcription, result: Result) -> list[Array]:
    """The program's quadrature compared with a finer one: `Quality.cost_error` of every phase."""
    problem, p = transcription.problem, result.parameters
    paid = [_integrals(*each, p) for each in zip(problem.phases, result.phases, strict=True)]
    scale = [1.0 + np.abs(values.sum(axis=0)) for values in paid]
    for values in scale:
        values[0] = 1.0 + abs(result.cost)
    for each in transcription.equations.element_blocks:
        block, own = each.block, paid[each.phase]
        mapped = block.function.map(block.count)
        outputs, cost = mapped(result.unknowns[block.variables], block.data)
        integrals = outputs.full()[len(block.rows) - (own.shape[1] - 1) :]
        own[each.group.elements] -= np.vstack([cost.full(), integrals]).T
    return [(np.abs(v) / s).max(axis=1) for v, s in zip(paid, scale, strict=True)]


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


def _at_ends(phase: Phase, trajectory: PhaseTrajectory) -> Array:
    """How far the ends, which have bounds of their own, are outside the bounds all along."""
    ends = np.stack([trajectory.start, trajectory.end])
    return np.asarray(np.maximum(beyond(ends, *phase.state_bounds()), 0.0).max(axis=0))


def _dense(trajectory: PhaseTrajectory) -> tuple[Array, Array, Array]:
    """States, their derivatives with respect to the fraction of the element, and controls.

    All on the dense grid, of shapes (M, samples, .).
    """
    basis = lagrange_matrix(trajectory.nodes, GRID)
    slope = basis @ full_differentiation_matrix(tuple(trajectory.nodes))
    controls = lagrange_matrix(trajectory.control_nodes, GRID) @ trajectory.controls
    return basis @ trajectory.states, slope @ trajectory.states, controls


def audit(problem: Problem, phases: Sequence[PhaseTrajectory], p: Array) -> tuple[Breach, ...]:
    """The worst violation of every limit that is violated between the nodes, worst first."""
    found: list[Breach] = []
    for phase, trajectory in zip(problem.phases, phases, strict=True):
        states, _, controls = _dense(trajectory)
        times = trajectory.edges[:-1, None] + trajectory.element_durations[:, None] * GRID
        outside = beyond(states, *phase.state_bounds()) - _at_ends(phase, trajectory)
        limits = [
            ("bound", phase.states, outside),
            ("bound", phase.controls, beyond(controls, *phase.control_bounds())),
        ]
        if phase.path is not None:
            values = evaluated(phase.path.function, states, controls, p)
            limits.append(("path constraint", phase.path.names, phase.path.violation(values)))
        for kind, names, outside in limits:
            for name, excess in zip(names, np.moveaxis(outside, -1, 0), strict=True):
                worst = np.unravel_index(np.argmax(excess), excess.shape)
                amount = float(excess[worst])
                if amount > NOTEWORTHY:
                    found.append(Breach(kind, name, phase.name, float(times[worst]), amount))
    return tuple(sorted(found, key=lambda breach: -breach.amount))
