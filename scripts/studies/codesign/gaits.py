"""The cheapest gait of a case, from random starts and from the gaits of other cases."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from scripts.studies.codesign.problem import SPEEDS, Case, chosen, regenerating
from trajopt.gaits.periodic import finished
from trajopt.gaits.problem import CONTROL_DEGREE
from trajopt.gaits.search import random_guess
from trajopt.gaits.solution import Solution
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.ranking import least_first
from trajopt.ocp.solve import solve

#: Random starts of a case.
STARTS = 3

#: Meshes (elements, degree): of the search, and the first one of the refined gait.
SEARCH_MESH, FIRST_MESH = (20, 5), (24, 7)

#: Tolerances of the refined mesh; IPOPT's first barrier and iterations.
MESH_ERROR, HAMILTONIAN, WARM_BARRIER, ITERATIONS = 1e-9, 1e-1, 1e-5, 200

#: Settings of a search's solves: one attempt each, on the search's mesh.
_QUICK: dict[str, Any] = {
    "passes": 0,
    "verify": False,
    "ladder": ({},),
    "max_iter": ITERATIONS,
}

#: Refinements of a gait's mesh at most.
PASSES = 5

#: Optima that are refined until one is verified, and by how much (relative) a gait must be
#: cheaper than the one that it replaces.
REFINED, WORTH_IT = 2, 1e-3


def cheapest(
    case: Case, known: Sequence[Solution] = (), starts: int = STARTS, seed: int = 0
) -> Solution | str:
    """The cheapest gait that passes verification, or the reason why there is none.

    Args:
        case: what it is to be.
        known: gaits of other cases to start from.
        starts: random ones besides.
        seed: of the random starts.
    """
    try:
        problem = case.problem()
    except ValueError as error:
        return str(error)
    mesh = Mesh.uniform(problem, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    guesses = [(gait.phases, np.array(chosen(gait.params))) for gait in known]
    low, high = np.array(list(case.bounds.values())).T
    found = []
    for phases, parameters in guesses:
        found.append(
            solve(
                *(problem, phases, mesh),
                parameters=np.clip(parameters, low, high),
                mu_init=1e-3,
                **_QUICK,
            )
        )
    rng = np.random.default_rng(seed)
    for _ in range(starts):
        smooth = solve(
            *(regenerating(problem), random_step(case, rng), mesh),
            parameters=(low + high) / 2,
            **_QUICK,
        )
        if smooth.succeeded:
            found.append(
                solve(
                    *(problem, smooth.phases, mesh),
                    parameters=smooth.parameters,
                    **_QUICK,
                )
            )
    good = [each for each in found if each.succeeded and not each.violations]
    reason = "no start led to a gait"
    for each in least_first(good, lambda extremal: extremal.transcribed_cost)[:REFINED]:
        gait = refined(case, each)
        if gait.verification.passed:
            return gait
        reason = "; ".join(gait.verification.failures)
    return reason


def cheaper(case: Case, best: Solution | str, known: Sequence[Solution]) -> Solution | str:
    """The gait led here from others if it is cheaper than `best`, else `best`."""
    other = cheapest(case, known, starts=0)
    if isinstance(other, str):
        return best
    better = isinstance(best, str) or other.cot < (1 - WORTH_IT) * best.cot
    return other if better else best


def refined(case: Case, near: Extremal) -> Solution:
    """A gait near an optimum of the search, on a finer mesh, verified."""
    problem = case.problem()
    found = solve(
        problem,
        near.phases,
        Mesh.uniform(problem, *FIRST_MESH, control_degree=CONTROL_DEGREE),
        parameters=near.parameters,
        tolerance=MESH_ERROR,
        hamiltonian_tolerance=HAMILTONIAN,
        passes=PASSES,
        verify=False,
        mu_init=WARM_BARRIER,
    )
    bob, arm = (float(value) for value in found.parameters)
    machine = case.build.machine(bob, arm)
    return finished(machine, found, case.turns, False, (), {"study": "codesign"})


def random_step(case: Case, rng: np.random.Generator) -> Guess:
    """A random step with the case's turns of theta."""
    params = case.build.machine(1.0, 0.1)
    slow, fast = SPEEDS
    speed = math.exp(rng.uniform(math.log(1.3 * slow), math.log(fast / 1.2)))
    (phase,), _ = random_guess(params, 1, params.step_length / speed, rng)
    states = phase.states.copy()
    missing = 2 * math.pi * case.turns - (states[-1, -1, 1] - states[0, 0, 1])
    share = np.linspace(0.0, 1.0, states[..., 0].size).reshape(states.shape[:2])
    states[..., 1] += missing * share
    states[..., 3] += missing / phase.duration
    return (dataclasses.replace(phase, states=states),)
