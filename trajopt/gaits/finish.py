"""From an optimum to a gait: its last digits corrected, and verified by the reference simulator."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from rimless_gym.trajectory import Trajectory
from trajopt.gaits.problem import stands
from trajopt.gaits.solution import Optimality, Solution
from trajopt.gaits.verify import (
    SPARE_TIMES,
    STATE_TOLERANCE,
    Span,
    begun,
    simulated_span,
    simulated_stride,
    span_map,
    spans,
    state_error,
    transition,
    verify,
)
from trajopt.ocp.arrays import Array
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.schemes import lagrange_matrix
from trajopt.ocp.solve import WARM_BARRIERS, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.store import provenance

#: Tolerance of the mesh on which a gait is solved again if it fails verification: a slow step may
#: magnify the error that the usual tolerance leaves, so that the simulation strays.
FINE_TOLERANCE = 1e-9

#: Newton steps at most, and the largest gap (rad, rad/s) that they are meant for.
NEWTON_STEPS, LARGEST_GAP = 3, 1e-2

#: Where an element's polynomial is compared with a simulation: fractions of the element.
WITHIN = (np.arange(16) + 0.5) / 16


def finished(
    params: WheelParams,
    optimum: Extremal,
    turns: int,
    regeneration: bool,
    settings: Mapping[str, object],
) -> Solution:
    """An optimum as a gait, verified by the reference simulator.

    One that fails is solved again on a finer mesh.

    Args:
        params: the machine.
        optimum: of the gait's problem.
        turns: whole turns that theta gains in a stride.
        regeneration: whether the objective was E.
        settings: of the search, for the provenance.
    """

    def gait(extremal: Extremal) -> Solution:
        phases = polished(params, extremal.phases, turns)
        return Solution(
            params=params,
            phases=phases,
            theta_turns=turns,
            regeneration=regeneration,
            verification=verify(params, phases, turns),
            optimality=Optimality.from_extremal(extremal),
            provenance=provenance(**settings),
        )

    solution = gait(optimum)
    if solution.verification.passed:
        return solution
    finer = solve(
        *(optimum.problem, optimum, optimum.mesh),
        tolerance=FINE_TOLERANCE,
        verify=False,
        mu_init=WARM_BARRIERS[-1],
    )
    again = gait(finer) if finer.succeeded else solution
    return again if again.verification.passed else solution


def polished(
    params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int
) -> tuple[PhaseTrajectory, ...]:
    """The gait with each span's initial state corrected by rounding-sized amounts.

    A slow step magnifies deviations by up to 1e6, so that the 1e-12 which a solver leaves would
    show. Newton's method on the reference simulation of all spans (multiple shooting), with the
    gait's own linearisation.
    """
    current = _landing_softly(params, phases)
    best, polished_phases = state_error(params, current, turns)[0], tuple(current)
    for _ in range(NEWTON_STEPS):
        if best < 0.1 * STATE_TOLERANCE:
            break
        parts = spans(params, current, turns)
        runs = [simulated_span(params, span, SPARE_TIMES[:1]) for span in parts]
        gaps = np.array([run.x[-1] - span.after for run, span in zip(runs, parts, strict=True)])
        ended = [
            len(run.events) == (span.following is not None)
            for run, span in zip(runs, parts, strict=True)
        ]
        if not all(ended) or np.abs(gaps).max() > LARGEST_GAP:
            break
        for span, shift in zip(parts, _shifts(params, parts, gaps), strict=True):
            start = span.phase.start + shift
            current[span.step] = begun(current[span.step], start, span.element)
        current = _landing_softly(params, current)
        error = state_error(params, current, turns)[0]
        if error < best:
            best, polished_phases = error, tuple(current)
    if STATE_TOLERANCE < best < math.inf:
        halved = _halved(params, polished_phases, turns)
        if state_error(params, halved, turns)[0] <= STATE_TOLERANCE:
            return halved
    return polished_phases


def _halved(
    params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int
) -> tuple[PhaseTrajectory, ...]:
    """The phases, with elements halved whose polynomials leave their own simulation.

    A control can be right, and the states at all edges to 1e-10, where the polynomial between
    them is not: its order is lower than the edges'. The halves follow the simulation. Spans whose
    simulation leaves their edges, too, remain as they are.
    """
    halved = list(phases)
    for span, run in reversed(state_error(params, phases, turns)[1]):
        part = span.phase
        if np.abs(run.state(part.edges[:-1]) - part.states[:, 0]).max() > 0.1 * STATE_TOLERANCE:
            continue
        for e in reversed(range(len(part.edges) - 1)):
            between = part.edges[e] + part.element_durations[e] * WITHIN
            if np.abs(run.state(between) - part.state(between)).max() > 0.5 * STATE_TOLERANCE:
                whole = halved[span.step]
                halved[span.step] = _halved_element(whole, span.element + e, run, part.edges[e])
    return tuple(halved)


def _halved_element(
    phase: PhaseTrajectory, e: int, run: Trajectory, begin: float
) -> PhaseTrajectory:
    """The phase with element e in two halves; `run` passes it from the time `begin` (s)."""
    width, halves = phase.element_durations[e], np.array([[0.0], [0.5]])
    states = run.state(begin + width * (halves + 0.5 * phase.nodes).ravel())
    states = states.reshape(2, len(phase.nodes), -1)
    states[0, 0], states[1, -1] = phase.states[e, 0], phase.states[e, -1]
    knots = phase.control_nodes
    basis = lagrange_matrix(knots, (halves + 0.5 * knots).ravel()).reshape(2, len(knots), -1)
    return dataclasses.replace(
        phase,
        edges=np.insert(phase.edges, e + 1, phase.edges[e] + 0.5 * width),
        states=np.concatenate([phase.states[:e], states, phase.states[e + 1 :]]),
        controls=np.concatenate(
            [phase.controls[:e], basis @ phase.controls[e], phase.controls[e + 1 :]]
        ),
    )


def _landing_softly(
    params: WheelParams, phases: Sequence[PhaseTrajectory]
) -> list[PhaseTrajectory]:
    """The phases, with theta' at the start of the step before a stop such that it lands as planned.

    A wheel that is to land with phi' = 1e-3 rad/s misses the ground by an error of 1e-8 rad. Of all
    figures of the landing, phi'^2 is the one that depends on the start smoothly.
    """
    corrected, b = list(phases), params.constants.b
    if not stands(phases[-1]):
        return corrected
    for _ in range(NEWTON_STEPS):
        step, following = corrected[-2:]
        run = simulated_stride(params, [step], SPARE_TIMES[:1], following)
        phi, _, rate, _ = run.events[0].before if run.events else run.x[-1]
        acceleration = float(HybridModel(params).flow(step.end, step.controls[-1, -1, 0])[2])
        excess = rate**2 + 2 * acceleration * (b - phi) - step.end[2] ** 2
        gain = transition(params, step)[:, 3]
        states = step.states.copy()
        states[0, 0, 3] -= 0.5 * excess / (step.end[2] * gain[2] - acceleration * gain[0])
        corrected[-2] = dataclasses.replace(step, states=states)
    return corrected


def _shifts(params: WheelParams, parts: Sequence[Span], gaps: Array) -> Array:
    """The changes of all spans' starts, (spans, 4), that close the gaps (spans, 4) after them.

    A step begins where its leg lands, and a leg that starts at rest stays at rest.
    """
    n = len(parts)
    matrix, free = np.zeros((n, 4, n, 4)), np.ones((n, 4), dtype=bool)
    for i, span in enumerate(parts):
        matrix[i, :, i] += span_map(params, span)
        matrix[i, :, (i + 1) % n] -= np.eye(4)
        free[i, 0] = span.element > 0
        free[i, 2] = span.element > 0 or span.phase.start[2] != 0.0
    unknowns, shifts = matrix.reshape(4 * n, 4 * n)[:, free.ravel()], np.zeros((n, 4))
    shifts[free] = -np.linalg.lstsq(unknowns, gaps.ravel(), rcond=1e-8)[0]
    return shifts
