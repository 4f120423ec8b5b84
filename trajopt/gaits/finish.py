"""From an optimum to a gait: its last digits corrected, and verified by the reference simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.gaits.problem import stands
from trajopt.gaits.solution import Optimality, Solution
from trajopt.gaits.verify import (
    SPARE_TIMES,
    STATE_TOLERANCE,
    begun,
    simulated_steps,
    simulated_stride,
    step_error,
    step_maps,
    successors,
    transition,
    verify,
)
from trajopt.ocp.arrays import Array
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.store import provenance

#: Tolerance of the mesh on which a gait is solved again if it fails verification: a slow step may
#: magnify the error that the usual tolerance leaves, so that the simulation strays.
FINE_TOLERANCE = 1e-9

#: Newton steps at most, and the largest gap (rad, rad/s) that they are meant for.
NEWTON_STEPS, LARGEST_GAP = 3, 1e-2


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
        mu_init=WARM_BARRIER,
    )
    again = gait(finer) if finer.succeeded else solution
    return again if again.verification.passed else solution


def polished(
    params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int
) -> tuple[PhaseTrajectory, ...]:
    """The gait with each step's initial rates and angle corrected by rounding-sized amounts.

    A slow step magnifies deviations by up to 1e6, so that the 1e-12 which a solver leaves would
    show. Newton's method on the reference simulation of all steps (multiple shooting), with the
    gait's own linearisation.
    """
    current = _landing_softly(params, phases)
    best, polished_phases = step_error(params, current, turns)[0], tuple(current)
    for _ in range(NEWTON_STEPS):
        if best < 0.1 * STATE_TOLERANCE:
            break
        runs = simulated_steps(params, current, SPARE_TIMES[:1])
        pairs = zip(runs, successors(current, turns), strict=True)
        gaps = np.array([run.x[-1] - after for run, after in pairs])
        if any(len(run.events) != 1 for run in runs) or np.abs(gaps).max() > LARGEST_GAP:
            break
        for i, shift in enumerate(_shifts(params, current, gaps)):
            current[i] = begun(current[i], current[i].start + [0.0, *shift])
        current = _landing_softly(params, current)
        error = step_error(params, current, turns)[0]
        if error < best:
            best, polished_phases = error, tuple(current)
    return polished_phases


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


def _shifts(params: WheelParams, phases: Sequence[PhaseTrajectory], gaps: Array) -> Array:
    """The changes of all phases' starts, phi left out, that close the gaps (phases, 4) after them.

    A leg that starts at rest stays at rest.
    """
    n = len(phases)
    matrix = np.zeros((n, 4, n, 4))
    for i, step in enumerate(step_maps(params, phases)):
        matrix[i, :, i] += step
        matrix[i, :, (i + 1) % n] -= np.eye(4)
    matrix[:, :, [phase.start[2] == 0.0 for phase in phases], 2] = 0.0
    unknowns = matrix[..., 1:].reshape(4 * n, 3 * n)
    return np.asarray(-np.linalg.lstsq(unknowns, gaps.ravel(), rcond=1e-8)[0]).reshape(n, 3)
