"""The cheapest gait of one scale, from random starts and from the gaits of other scales."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from scripts.studies.thesis.prototype.starts import StartsAtScale
from scripts.studies.thesis.prototype.variant import Variant
from trajopt.gaits.periodic import finished
from trajopt.gaits.problem import CONTROL_DEGREE
from trajopt.gaits.search import same_gait
from trajopt.gaits.solution import LocalOptimum, Solution
from trajopt.ocp.continuation import Curve, Obstacle, continued
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome, multi_start
from trajopt.ocp.ranking import least_first
from trajopt.ocp.solve import WARM_BARRIER, solve

#: Random starts per scale, and how many of their optima are refined until one is verified.
STARTS, REFINED = 16, 2

#: Meshes (elements, degree): of the search, and the first one of the refined gait.
SEARCH_MESH, FIRST_MESH = (20, 5), (24, 7)

#: Tolerances of the refined mesh. A whirling pendulum makes the errors of a step large.
MESH_ERROR, HAMILTONIAN = 1e-9, 1e-1

#: Longest step in scale by which a gait is led to another one.
LED_STEP = 0.1

#: By how much (relative) a gait must be cheaper than the one that it replaces.
WORTH_IT = 1e-3


def cheapest(
    variant: Variant, scale: float, known: Sequence[Solution] = (), seed: int = 0
) -> tuple[Solution | None, str]:
    """The cheapest gait that passes verification and "", or None and the reason.

    Args:
        variant: supply and gear.
        scale: of the pendulum.
        known: gaits of other scales, from which some starts begin.
        seed: of the random starts.
    """
    family = StartsAtScale(variant, scale, tuple(known))
    base = variant.problem(scale, 0)
    mesh = Mesh.uniform(base, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    search = multi_start(*(base, family, STARTS + len(known)), seed=seed, mesh=mesh, same=same_gait)
    reasons = [outcome.failure for outcome in search.failures]
    optima = tuple(LocalOptimum(o.cost, int(o.best.kind), len(o.starts)) for o in search.optima)
    for optimum in search.optima[:REFINED]:
        best = optimum.best
        found = refined(variant, scale, best, int(best.kind), optima)
        if found.verification.passed:
            return found, ""
        reasons.insert(0, "; ".join(found.verification.failures))
    return None, reasons[0] if reasons else "no start was given"


def cheaper(
    variant: Variant, scale: float, best: float, known: Sequence[Solution]
) -> Solution | None:
    """A verified gait that costs less than `best`, led here from other gaits; or None."""
    reached = []
    for gait in known:
        curve = followed(variant, gait, scale)
        if curve.reached and curve.solutions[-1].transcribed_cost < (1 - WORTH_IT) * best:
            reached.append((curve.solutions[-1], gait))
    for extremal, gait in least_first(reached, lambda pair: pair[0].transcribed_cost):
        found = refined(variant, scale, extremal, gait.theta_turns, gait.optima)
        if found.verification.passed and found.cot < (1 - WORTH_IT) * best:
            return found
    return None


def followed(variant: Variant, gait: Solution, scale: float) -> Curve:
    """A gait of another scale or supply, followed towards this one on a coarse mesh.

    Args:
        variant: supply and gear.
        gait: where to begin.
        scale: goal.
    """
    begin, gear = variant.scale_and_gear(gait)
    problem = variant.problem(begin, gait.theta_turns)
    mesh = Mesh.uniform(problem, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    settings: dict[str, Any] = {"passes": 0, "verify": False}
    parameters = np.array([begin, gear])
    start = solve(
        *(problem, gait.phases, mesh), parameters=parameters, mu_init=WARM_BARRIER, **settings
    )
    if not start.succeeded:
        return Curve(scale, obstacle=Obstacle(begin, "; ".join(start.failures), start))
    if math.isclose(begin, scale, rel_tol=1e-9):  # the gait's own scale, read off its machine
        return Curve(scale, (scale,), (start,))
    return continued(
        lambda s: variant.problem(s, gait.theta_turns),
        start,
        [begin, scale],
        step=LED_STEP,
        **settings,
    )


def refined(
    variant: Variant,
    scale: float,
    near: Outcome | Extremal,
    turns: int,
    optima: tuple[LocalOptimum, ...],
) -> Solution:
    """A gait near an optimum of the search, on a finer mesh, verified."""
    problem = variant.problem(scale, turns)
    found = solve(
        problem,
        near.phases,
        Mesh.uniform(problem, *FIRST_MESH, control_degree=CONTROL_DEGREE),
        parameters=near.parameters,
        tolerance=MESH_ERROR,
        hamiltonian_tolerance=HAMILTONIAN,
        verify=False,
        mu_init=WARM_BARRIER,
    )
    machine = variant.machine(scale, float(found.parameters[1]))
    settings = {"scale": scale, "variant": variant.name, "starts": STARTS}
    return finished(machine, found, turns, False, optima, settings)
