"""Solving for a local minimum: not a saddle, and not values on their way to infinity.

IPOPT stops wherever the first-order conditions hold. That may be a saddle or a maximum, if the
guess lies there by symmetry. And if a cost falls for ever, but ever more slowly, any large enough
values satisfy them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.pose.problem import Array, Problem
from trajopt.ocp.transcribe.nlp import DIVERGING, Result, Transcription
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: By how much a guess is moved off what may be a saddle, relative to 1 + the largest state.
NUDGE = 1e-2

#: If a value exceeds `LARGE`, the problem is solved again with a tolerance finer by `FINER`; values
#: that then grow by the factor `GROWN` have no limit.
LARGE, FINER, GROWN = 1e4, 1e-4, 2.0

#: Values and costs that only a cost without a minimum leads to.
HUGE_VALUE, HUGE_COST = 1e10, 1e20


def minimum(
    transcription: Transcription,
    guess: Sequence[PhaseTrajectory],
    problem: Problem | None = None,
    parameters: Array | None = None,
    **options: Any,
) -> Result:
    """Like `Transcription.solve`, but for a minimum.

    The result's status is `DIVERGING` if there is none.
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


def largest(
    problem: Problem, phases: Sequence[PhaseTrajectory], parameters: Array
) -> tuple[str, float]:
    """A description of a solution's largest quantity, and its magnitude."""
    sizes = {
        f"parameter {name}": abs(float(value))
        for name, value in zip(problem.parameters, parameters, strict=True)
    }
    for phase, trajectory in zip(problem.phases, phases, strict=True):
        sizes[f"the duration of phase {phase.name!r}"] = abs(trajectory.duration)
        both = (phase.states, trajectory.states), (phase.controls, trajectory.controls)
        for names, values in both:
            for name, size in zip(names, np.abs(values).max(axis=(0, 1)), strict=True):
                sizes[f"{name} of phase {phase.name!r}"] = float(size)
    return max(sizes.items(), key=lambda item: item[1])


def _largest(result: Result) -> float:
    return float(np.abs(result.unknowns).max())


def _nudged(phases: Sequence[PhaseTrajectory]) -> list[PhaseTrajectory]:
    """The phases moved at random, the same way every time."""
    rng, moved = np.random.default_rng(0), []
    for phase in phases:
        changes = {}
        for name in ("states", "controls"):
            values = getattr(phase, name)
            size = NUDGE * (1.0 + np.abs(values).max(initial=0.0))
            changes[name] = values + size * rng.normal(size=values.shape)
        moved.append(dataclasses.replace(phase, **changes))
    return moved
