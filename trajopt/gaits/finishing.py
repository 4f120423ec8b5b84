"""From an optimum to a gait: corrected by the last rounding-sized amounts, and verified."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.optimality import LocalOptimum, Optimality
from trajopt.gaits.playback import played_to_last_touchdown
from trajopt.gaits.solution import Solution
from trajopt.gaits.stability import monodromy
from trajopt.gaits.verify import SPARE_TIMES, STATE_TOLERANCE, stride_error, verify
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.provenance import provenance

#: Tolerance of the mesh on which a gait is solved again if it fails verification: a stride may
#: magnify the error that the usual tolerance leaves, so that the simulation strays.
FINE_TOLERANCE = 1e-9

#: Newton steps at most, and the largest gap (rad, rad/s) that they are meant for.
NEWTON_STEPS, LARGEST_GAP = 3, 1e-2


def finished(
    params: WheelParams,
    found: Extremal,
    turns: int,
    regeneration: bool,
    optima: tuple[LocalOptimum, ...],
    settings: Mapping[str, object],
) -> Solution:
    """An optimum as a gait, verified by the reference simulator.

    One that fails is solved again on a finer mesh.

    Args:
        params: the machine.
        found: the optimum.
        turns: whole turns that theta gains in a stride.
        regeneration: whether the objective was E.
        optima: met in the search.
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
            optimality=Optimality.of(extremal),
            optima=optima,
            provenance=provenance(**settings),
        )

    solution = gait(found)
    if solution.verification.passed:
        return solution
    finer = solve(
        *(found.problem, found, found.mesh),
        tolerance=FINE_TOLERANCE,
        verify=False,
        mu_init=WARM_BARRIER,
    )
    again = gait(finer) if finer.succeeded else solution
    return again if again.verification.passed else solution


def polished(
    params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int
) -> tuple[PhaseTrajectory, ...]:
    """The gait with its initial rates and pendulum angle corrected by rounding-sized amounts.

    A stride magnifies deviations by up to 1e6, so that the 1e-12 which a solver leaves would show.
    Newton's method on the reference simulation, with the gait's own linearisation.
    """
    current = list(phases)
    best, kept = stride_error(params, current, turns)[0], tuple(phases)
    for _ in range(NEWTON_STEPS):
        if best < 0.1 * STATE_TOLERANCE:
            break
        run = played_to_last_touchdown(params, current, SPARE_TIMES[:1])
        target = kept[0].start + np.array([0.0, 2 * math.pi * turns, 0.0, 0.0])
        gap = run.x[-1] - target
        if run.steps != len(phases) or np.abs(gap).max() > LARGEST_GAP:
            break
        sensitivity = monodromy(params, current)[:, 1:]
        shift = -np.linalg.lstsq(sensitivity, gap, rcond=1e-8)[0]
        states = current[0].states.copy()
        states[0, 0, 1:] += shift
        current[0] = dataclasses.replace(current[0], states=states)
        error = stride_error(params, current, turns)[0]
        if error < best:
            best, kept = error, tuple(current)
    return kept
