"""How accurate a solution on a mesh is: errors between the nodes, and violated limits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import DOP853

from trajopt.ocp.arrays import Array
from trajopt.ocp.certificate import (
    GRID,
    Certificate,
    certificate,
    limits_on_grid,
    quadratures,
)
from trajopt.ocp.constraints import NOTEWORTHY, Violation
from trajopt.ocp.layout import evaluated
from trajopt.ocp.pontryagin import finite
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.scaling import PhaseScales, Scales, jacobian, scales_of
from trajopt.ocp.schemes import full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Result, Transcription

#: By how much refining the mesh may raise the cost of one and the same optimum (relative).
SAME_COST = 5e-3

#: IPOPT's status where a function or a derivative is not finite.
UNDEFINED = "Invalid_Number_Detected"

#: Steps of the 8th-order integrator per element: the fewest and the most, and how many of the
#: fastest time constants of a stiff motion a step may last, within which it is stable.
STEPS, STABLE = (2, 200), 4.0


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
        whole = self.scales.cost + abs(result.cost)
        costs = zip(self.certificate.cost_gaps, self.certificate.limit_costs, strict=True)
        gaps = [(control + limits) / whole for control, limits in costs]
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

    @cached_property
    def limits(self) -> tuple[Violation, ...]:
        """Limits that are violated between the nodes, worst first; see `audit`."""
        result, problem = self.result, self.transcription.problem
        solution = result.phases, result.parameters
        slopes = _undefined(problem, *solution, jacobian) if result.status == UNDEFINED else []
        return (*slopes, *audit(problem, *solution, self.scales))

    def costs_more_than(self, other: Candidate) -> bool:
        """Whether it costs so much more that it must be another optimum."""
        cost = other.result.cost
        return self.result.cost - cost > SAME_COST * max(abs(cost), 1e-9 * self.scales.cost)


@dataclasses.dataclass(frozen=True)
class Quality:
    """The errors of a phase, element by element, between the nodes of its mesh.

    Errors of states are relative to the scale of the state + its largest magnitude in the phase,
    violations to the scale of what is violated.
    """

    # the largest magnitude of the residual x' - flow(x, u), integrated from the element's left
    # edge, shape (M,)
    defect_error: Array
    # difference at the right edge to an explicit 8th-order integration from the left edge under the
    # element's own control, shape (M,)
    step_error: Array
    limit_violation: Array  # largest violation of a bound on a state or control, shape (M,)
    path_violation: Array  # largest violation of each path constraint, shape (M, m)
    # error of the program's quadrature of costs and integrals, relative to the scale + the
    # magnitude of the whole, shape (M,)
    cost_error: Array
    # `Certificate.cost_gaps` + `limit_costs`, relative to the scale + the magnitude of the cost,
    # shape (M,)
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
    limits = [outside for _, _, outside in limits_on_grid(phase, trajectory, p, scales)]
    path = np.maximum(limits[2].max(axis=1), 0.0) if limits[2:] else np.zeros((len(states), 1))
    outside = np.concatenate(limits[:2], axis=-1)
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
    relative = []
    for (values, errors), units in zip(
        quadratures(transcription, result), scales.phases, strict=True
    ):
        scale = np.r_[scales.cost, units.integral] + np.abs(values.sum(axis=0))
        scale[0] = scales.cost + abs(result.cost)
        relative.append((np.abs(errors) / scale).max(axis=1))
    return relative


def stepped(phase: Phase, trajectory: PhaseTrajectory, p: Array) -> Array:
    """States (M, nx) at the elements' right edges, integrated from their left edges.

    They may be infinite or NaN where a motion is too stiff for an explicit method.
    """
    rates = np.abs(np.linalg.eigvals(mean_slopes(phase, trajectory, p))).max(axis=1)
    needed = math.ceil((rates * trajectory.element_durations).max() / STABLE)
    steps = min(max(needed, STEPS[0]), STEPS[1])
    y, h = trajectory.states[:, 0], trajectory.element_durations[:, None] / steps
    for step in range(steps):
        flows: list[Array] = []
        for i, row in enumerate(DOP853.A):
            x = y + h * sum((a * f for a, f in zip(row, flows, strict=False)), start=0.0 * y)
            s = (step + DOP853.C[i]) / steps
            basis = lagrange_matrix(trajectory.control_nodes, np.array([s]))[0]
            u = np.einsum("m,emu->eu", basis, trajectory.controls)
            flows.append(evaluated(phase.flow, x, u, p))
        y = y + h * sum((b * f for b, f in zip(DOP853.B, flows, strict=True)), start=0.0 * y)
    return y


def mean_slopes(phase: Phase, trajectory: PhaseTrajectory, p: Array) -> Array:
    """The derivatives of the flow with respect to the states, every element's mean (M, nx, nx)."""
    nx = len(phase.states)
    controls = lagrange_matrix(trajectory.control_nodes, trajectory.nodes) @ trajectory.controls
    slopes = evaluated(jacobian(phase.flow), trajectory.states, controls, p)[..., : nx * nx]
    return finite(slopes.mean(axis=1)).reshape(-1, nx, nx).swapaxes(1, 2)


def _dense(trajectory: PhaseTrajectory) -> tuple[Array, Array, Array]:
    """States, their derivatives with respect to the fraction of the element, and controls.

    All on the dense grid, of shapes (M, samples, .).
    """
    basis = lagrange_matrix(trajectory.nodes, GRID)
    slope = basis @ full_differentiation_matrix(tuple(trajectory.nodes))
    controls = lagrange_matrix(trajectory.control_nodes, GRID) @ trajectory.controls
    return basis @ trajectory.states, slope @ trajectory.states, controls


def _undefined(
    problem: Problem,
    phases: Sequence[PhaseTrajectory],
    p: Array,
    of: Callable[[Any], Any] = lambda function: function,
) -> list[Violation]:
    """Every function's first time at which it, or its Jacobian, is not finite."""
    violations = []
    for phase, trajectory in zip(problem.phases, phases, strict=True):
        times = trajectory.edges[:-1, None] + trajectory.element_durations[:, None] * GRID
        x, _, u = _dense(trajectory)
        for kind in ("flow", "cost", "powers", "path", "integral"):
            given = getattr(phase, kind)
            if given is None:
                continue
            names = phase.states if kind == "flow" else getattr(given, "names", None)
            function = getattr(given, "function", given)
            values = evaluated(of(function), x, u, p)
            values = values.reshape(*values.shape[:2], -1, function.size1_out(0))
            called = kind if of(function) is function else f"derivative of {kind}"
            for row in np.flatnonzero(~np.isfinite(values).all(axis=(0, 1, 2))):
                time = float(times[~np.isfinite(values[..., row]).all(axis=-1)].min())
                name = names[row] if names else ""
                violations.append(Violation(called, name, phase.name, time, math.inf, math.inf))
    return violations


def audit(
    problem: Problem, phases: Sequence[PhaseTrajectory], p: Array, scales: Scales
) -> tuple[Violation, ...]:
    """The worst violation of every limit that is violated between the nodes, worst first.

    Functions that are not finite somewhere count as infinite violations.
    """
    violations = _undefined(problem, phases, p)
    for phase, trajectory, each in zip(problem.phases, phases, scales.phases, strict=True):
        times = trajectory.edges[:-1, None] + trajectory.element_durations[:, None] * GRID
        for kind, units, outside in limits_on_grid(phase, trajectory, p, each):
            rows = zip(units.items(), np.moveaxis(outside, -1, 0), strict=True)
            for (name, unit), excess in rows:
                worst = np.unravel_index(np.argmax(excess), excess.shape)
                relative = float(excess[worst])
                if relative > NOTEWORTHY:
                    amounts = float(times[worst]), unit * relative, relative
                    violations.append(Violation(kind, name, phase.name, *amounts))
    return tuple(sorted(violations, key=lambda violation: -violation.relative))
