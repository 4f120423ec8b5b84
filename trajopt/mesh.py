"""Mesh refinement: measure a solution between its nodes, and split the elements that fall short."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from trajopt.interpolant import PhaseTrajectory
from trajopt.polynomials import full_differentiation_matrix, lagrange_matrix
from trajopt.problem import Array, Constraint, Phase, Problem
from trajopt.radau import Transcription
from trajopt.transcription import Mesh, Result

SAMPLES = 12  # per element, between the nodes


@dataclasses.dataclass(frozen=True)
class Quality:
    """A phase's shortcomings, element by element, between the nodes of its mesh.

    Attributes:
        state_error: estimated error of the interpolated state, shape (M,).
        bound_violation: of the bounds on states, shape (M,).
        path_violation: of each path constraint, shape (M, m).
    """

    state_error: Array
    bound_violation: Array
    path_violation: Array


def assess(phase: Phase, trajectory: PhaseTrajectory) -> Quality:
    """Measure a solution on a dense grid within its elements.

    The state error is the integral of the residual |x' - flow(x, u)| over an element, from the
    left edge to wherever it is largest.
    """
    s = np.linspace(0.0, 1.0, SAMPLES + 1)
    basis = lagrange_matrix(trajectory.nodes, s)
    slope = basis @ full_differentiation_matrix(tuple(trajectory.nodes))
    states = np.einsum("sn,enx->esx", basis, trajectory.states)
    rates = np.einsum("sn,enx->esx", slope, trajectory.states)
    control_basis = lagrange_matrix(trajectory.control_nodes, s)
    controls = np.einsum("sn,enx->esx", control_basis, trajectory.controls)
    columns = states.reshape(-1, states.shape[-1]).T, controls.reshape(-1, controls.shape[-1]).T
    flow = np.asarray(phase.flow(*columns)).T.reshape(states.shape)
    residual = rates - trajectory.element_durations[:, None, None] * flow
    integral = np.cumsum(0.5 * (residual[:, 1:] + residual[:, :-1]), axis=1) / SAMPLES
    path = np.asarray(phase.path.function(*columns)).T.reshape(*states.shape[:2], -1)
    lower, upper = phase.state_bounds
    outside = np.maximum(lower - states, states - upper)
    outside -= max(0.0, outside[0, 0].max(), outside[-1, -1].max())  # the ends have their own
    return Quality(
        np.abs(integral).max(axis=(1, 2)),
        np.maximum(outside, 0.0).max(axis=(1, 2)),
        phase.path.violation(path).max(axis=1),
    )


def refined(
    mesh: Mesh, qualities: Sequence[Quality], state_tolerance: float, path_tolerance: float
) -> Mesh:
    """Halve the elements that miss a tolerance; the same mesh if none does."""
    fractions = []
    for edges, quality in zip(mesh.fractions, qualities, strict=True):
        bad = np.maximum(quality.state_error, quality.bound_violation) > state_tolerance
        bad |= quality.path_violation.max(axis=1) > path_tolerance
        middles = [0.5 * (edges[i] + edges[i + 1]) for i in np.flatnonzero(bad)]
        fractions.append(tuple(sorted([*edges, *map(float, middles)])))
    return dataclasses.replace(mesh, fractions=tuple(fractions))


def tightened(problem: Problem, margins: Sequence[Array]) -> Problem:
    """`problem` with every phase's lower path bounds raised by margins (m,)."""
    phases = []
    for phase, margin in zip(problem.phases, margins, strict=True):
        path = Constraint(
            phase.path.function, phase.path.lower + margin, phase.path.upper, phase.path.names
        )
        phases.append(dataclasses.replace(phase, path=path))
    return dataclasses.replace(problem, phases=tuple(phases))


def solve_refined(
    problem: Problem,
    guess: Sequence[PhaseTrajectory],
    mesh: Mesh,
    *,
    passes: int = 4,
    state_tolerance: float = 1e-7,
    path_tolerance: float = 1e-3,
    mu_init: float = 1e-4,
) -> Result:
    """Solve near `guess`, refining the mesh and at last tightening the path constraints.

    Where an optimal control switches, polynomials overshoot a little whatever the mesh; the last
    pass therefore moves the path's lower bounds by the overshoot that it found.

    Args:
        problem: what to solve.
        guess: one trajectory per phase.
        mesh: to begin with.
        passes: at most so many refinements.
        state_tolerance: of the estimated state error within an element.
        path_tolerance: of path constraints between nodes, before tightening.
        mu_init: IPOPT's first barrier; small, or a warm start leaves for another optimum.
    """
    result = Transcription(problem, mesh).solve(guess, mu_init=mu_init)
    for _ in range(passes):
        if not result.success:
            return result
        qualities = [assess(p, t) for p, t in zip(problem.phases, result.phases, strict=True)]
        finer = refined(mesh, qualities, state_tolerance, path_tolerance)
        if finer == mesh:
            break
        mesh = finer
        result = Transcription(problem, mesh).solve(result.phases, mu_init=mu_init)
    return _back_off(problem, result, mesh, mu_init)


def _back_off(problem: Problem, result: Result, mesh: Mesh, mu_init: float) -> Result:
    transcription, margins = (
        Transcription(problem, mesh),
        [0.0 * p.path.lower for p in problem.phases],
    )
    for _ in range(3):
        if not result.success:
            break
        excess = [
            assess(p, t).path_violation.max(axis=0)
            for p, t in zip(problem.phases, result.phases, strict=True)
        ]
        if max(e.max() for e in excess) < 1e-6:
            break
        margins = [m + 1.2 * e for m, e in zip(margins, excess, strict=True)]
        result = transcription.solve(result.phases, tightened(problem, margins), mu_init=mu_init)
    return result
