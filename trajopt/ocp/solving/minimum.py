"""Solving for a local minimum: not for a saddle, nor for values on their way to infinity.

IPOPT stops wherever the first-order conditions hold. That is a saddle or a maximum if the guess
lies there by symmetry. And where a cost falls for ever, but ever more slowly, the conditions hold
at any values that are large enough.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.transcribe.nlp import DIVERGING, Result, Transcription
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: By how much a guess is moved away from a possible saddle, relative to 1 + the largest value.
NUDGE = 1e-2

#: If a value exceeds `LARGE`, the problem is solved again with its tolerance multiplied by `FINER`;
#: values that then grow by the factor `GROWN` have no limit.
LARGE, FINER, GROWN = 1e4, 1e-4, 2.0

#: Larger values, and costs below minus the second, occur only where the cost has no minimum.
HUGE_VALUE, HUGE_COST = 1e10, 1e20


def minimum(
    transcription: Transcription,
    guess: Sequence[PhaseTrajectory],
    problem: Problem | None = None,
    parameters: Array | None = None,
    **options: Any,
) -> Result:
    """Like `Transcription.solve`, but for a minimum.

    The result's status is `DIVERGING` if the cost has no minimum.
    """
    result = transcription.solve(guess, problem, parameters, **options)
    if result.success and result.may_be_saddle:
        moved = _nudged(result.phases)
        other = transcription.solve(moved, problem, result.parameters, **options)
        if other.cost < result.cost - 1e-6 * (1.0 + abs(result.cost)):
            result = other
    if result.success and _largest(result) > LARGE:
        finer = options | {"tol": FINER * options.get("tol", 1e-8), "mu_init": 1e-8}
        again = transcription.solve(result.phases, problem, result.parameters, **finer)
        if _largest(again) > GROWN * _largest(result):
            result = dataclasses.replace(again, success=False, status=DIVERGING)
    if not result.success and (_largest(result) > HUGE_VALUE or -result.cost > HUGE_COST):
        result = dataclasses.replace(result, status=DIVERGING)
    return result


def _largest(result: Result) -> float:
    return float(np.abs(result.unknowns).max())


def _nudged(phases: Sequence[PhaseTrajectory]) -> list[PhaseTrajectory]:
    """The phases, moved at random in the same way every time."""
    rng, moved = np.random.default_rng(0), []
    for phase in phases:
        changes = {}
        for name in ("states", "controls"):
            values = getattr(phase, name)
            size = NUDGE * (1.0 + np.abs(values).max(initial=0.0))
            changes[name] = values + size * rng.normal(size=values.shape)
        moved.append(dataclasses.replace(phase, **changes))
    return moved
