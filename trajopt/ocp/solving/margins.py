"""Margins to path constraints, so that they hold between the nodes too.

Where an optimal control switches, polynomials overshoot a little whatever the mesh. Path
constraints are therefore moved inwards by what they overshoot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.judge.candidate import Candidate
from trajopt.ocp.pose.constraint import Constraint
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.solving.runs import WARM_BARRIERS

#: How often constraints are moved inwards at most, and by what multiple of the overshoot.
PASSES, SAFETY = 3, 1.2


def within_limits(
    sharper: Candidate, plain: Candidate, tolerance: float, options: Mapping[str, Any]
) -> Candidate:
    """The sharper of two solutions with margins; the plain one where that costs clearly less.

    Where an optimal control switches, the cost of staying within limits depends on the mesh.

    Args:
        sharper: the solution whose Hamiltonian varies less.
        plain: the other one, of the same problem.
        tolerance: of violations between the nodes.
        options: of IPOPT.
    """
    best = _backed_off(sharper, tolerance, options)
    inside = best.overshoot < tolerance
    if inside and not best.dearer_than(sharper):
        return best
    other = _backed_off(plain, tolerance, options)
    if not inside or (other.overshoot < tolerance and best.dearer_than(other)):
        return other
    return best


def _backed_off(candidate: Candidate, tolerance: float, options: Mapping[str, Any]) -> Candidate:
    """The solution with path constraints moved inwards by what it overshoots."""
    transcription, problem = candidate.transcription, candidate.transcription.problem
    margins: list[Array | float] = [0.0 for _ in problem.phases]
    for _ in range(PASSES):
        excess = [quality.path_violation.max(axis=0) for quality in candidate.qualities]
        if max(e.max() for e in excess) < tolerance:
            break
        margins = [m + SAFETY * e for m, e in zip(margins, excess, strict=True)]
        warm = {"mu_init": WARM_BARRIERS[0], **options}
        result, tight = candidate.result, tightened(problem, margins)
        found = transcription.solve(result.phases, tight, result.parameters, **warm)
        if not found.success:
            break
        candidate = Candidate(transcription, found)
    return candidate


def tightened(problem: Problem, margins: Sequence[Array | float]) -> Problem:
    """The problem with every phase's path bounds moved inwards by margins (m,)."""
    phases = []
    for phase, margin in zip(problem.phases, margins, strict=True):
        path = phase.path
        if path is not None:
            middle = 0.5 * (path.lower + path.upper)
            lower = np.fmin(path.lower + margin, np.where(np.isfinite(middle), middle, np.inf))
            upper = np.fmax(path.upper - margin, np.where(np.isfinite(middle), middle, -np.inf))
            path = Constraint(path.function, lower, upper, path.names)
        phases.append(dataclasses.replace(phase, path=path))
    return dataclasses.replace(problem, phases=tuple(phases))
