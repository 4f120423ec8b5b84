"""Solve a problem: discretise, refine until it is accurate, verify."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rimless_gym.checks import flag, integer, positive, require_kind
from trajopt.ocp.judge.accuracy import Quality, assess, audit, cost_errors
from trajopt.ocp.judge.costates import certificate
from trajopt.ocp.judge.extremal import Attempt, Extremal
from trajopt.ocp.judge.refinement import certified, refined
from trajopt.ocp.judge.resimulation import resimulated
from trajopt.ocp.pose.problem import Array, Constraint, Problem
from trajopt.ocp.solving.guesses import straight_lines
from trajopt.ocp.solving.interrupted import heeded
from trajopt.ocp.solving.minimum import minimum
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import Result, Transcription
from trajopt.ocp.transcribe.options import require_options
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: What is tried, one after the other, where IPOPT fails: options over `options.IPOPT`.
LADDER: tuple[dict[str, Any], ...] = (
    {},
    {"mu_strategy": "adaptive"},
    {"mu_init": 1.0, "bound_push": 0.1, "bound_frac": 0.1},
    {"mu_strategy": "adaptive", "nlp_scaling_method": "none", "max_iter": 1500},
)

#: IPOPT's first barrier on a finer mesh: small, or a warm start leaves for another optimum. The
#: second is for when the first fails.
WARM_BARRIER, WARM_BARRIERS = 1e-4, (1e-4, 1e-6)
WARM_ITERATIONS = 150


#: Errors that differ by less (relative) are equal: a solver leaves the last digits open.
EQUAL = 0.01

#: Refinements for the sake of the Hamiltonian, and by how much the cost of an accurate solution
#: may rise by refinement (relative) before it counts as another optimum.
CERTIFYING_PASSES, SAME_COST = 5, 5e-3


@heeded()
def solve(
    problem: Problem,
    guess: Sequence[PhaseTrajectory] | Extremal | None = None,
    mesh: Mesh | None = None,
    *,
    parameters: Array | None = None,
    tolerance: float = 1e-7,
    cost_tolerance: float = 1e-6,
    limit_tolerance: float = 1e-6,
    hamiltonian_tolerance: float = 1e-3,
    passes: int = 10,
    verify: bool = True,
    ladder: Sequence[dict[str, Any]] = LADDER,
    transcription: Transcription | None = None,
    **options: Any,
) -> Extremal:
    """A local optimum near a guess, on a mesh refined to a tolerance, verified.

    Args:
        problem: what to solve.
        guess: one trajectory per phase on any mesh, or another solution; straight lines between
            the bounds by default.
        mesh: to begin with; 10 elements of degree 4 per phase by default.
        parameters: guess of the static parameters; the middle of their bounds by default.
        tolerance: of the estimated relative error of the states within an element.
        cost_tolerance: of the error of the cost, and of what a control costs too much, within an
            element, relative to 1 + |cost|; guides the refinement alone.
        limit_tolerance: of bounds and path constraints between the nodes.
        hamiltonian_tolerance: of its change over an element, relative; elements that exceed it are
            halved a few times, for as long as that helps.
        passes: refinements at most; 0 solves on `mesh` alone.
        verify: whether to play the solution back; without, its `cost` is the transcription's.
        ladder: options of IPOPT tried one after the other, over `options`; ``({},)`` tries once.
        transcription: to begin with, of a problem that differs from this one in numbers alone;
            made anew by default. Its mesh is taken, whatever `mesh` is.
        options: of IPOPT; a small ``mu_init`` keeps a warm start near.

    Returns:
        The solution, whether it converged or not: see `Extremal.converged` and `report`.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        TypeError: an argument is of the wrong kind.
        ValueError: an argument is out of its range, does not fit the problem, or is an option that
            IPOPT does not have.
    """
    require_kind("problem", problem, Problem)
    for name, value in (
        ("tolerance", tolerance),
        ("cost_tolerance", cost_tolerance),
        ("limit_tolerance", limit_tolerance),
        ("hamiltonian_tolerance", hamiltonian_tolerance),
    ):
        positive(name, value)
    passes, verify = integer("passes", passes, 0), flag("verify", verify)
    _require_ladder(ladder, options)
    if transcription is not None:
        require_kind("transcription", transcription, Transcription)
    if isinstance(guess, Extremal):
        guess = guess.phases
    guess = straight_lines(problem) if guess is None else guess
    if transcription is None:
        mesh = Mesh.uniform(problem) if mesh is None else mesh
        transcription = Transcription(problem, mesh)
    transcription, mesh = transcription.posed(problem), transcription.mesh
    attempts: list[Attempt] = []
    result = _climb(transcription, guess, parameters, ladder, attempts, options)
    qualities = _assess(transcription, result)
    best = transcription, result, qualities
    for _ in range(passes):
        if not result.success:
            break
        finer = refined(
            *(mesh, problem, result.phases, result.parameters, qualities),
            *(tolerance, cost_tolerance, limit_tolerance),
        )
        if finer == mesh:
            break
        mesh, transcription = finer, Transcription(problem, finer)
        result = _again(transcription, result, attempts, options)
        qualities = _assess(transcription, result)
        settled = _error(best[2]) <= tolerance
        if not result.success or (settled and _dearer(result, best[1])):
            break
        if _shortfall(qualities, tolerance) <= (1 + EQUAL) * _shortfall(best[2], tolerance):
            best = transcription, result, qualities
    transcription, result, qualities = best
    if passes and result.success:
        sharper = _certified(transcription, result, hamiltonian_tolerance, attempts, options)
        transcription, result = _within(sharper, best[:2], limit_tolerance, options)
        qualities = _assess(transcription, result)
    return Extremal(
        problem=problem,
        mesh=transcription.mesh,
        phases=result.phases,
        parameters=result.parameters,
        tolerance=tolerance,
        limit_tolerance=limit_tolerance,
        transcribed_cost=result.cost,
        mesh_error=_error(qualities),
        status=result.status,
        attempts=tuple(attempts),
        breaches=result.breaches,
        audit=audit(problem, result.phases, result.parameters),
        certificate=certificate(transcription, result),
        resimulation=resimulated(problem, result.phases, result.parameters) if verify else None,
    )


def _assess(transcription: Transcription, result: Result) -> list[Quality]:
    gaps = certificate(transcription, result).cost_gaps(result.phases, result.cost)
    errors = cost_errors(transcription, result)
    each = zip(transcription.problem.phases, result.phases, errors, gaps, strict=True)
    return [
        assess(phase, trajectory, result.parameters, error, gap)
        for phase, trajectory, error, gap in each
    ]


def _error(qualities: Sequence[Quality]) -> float:
    return float(max(quality.state_error.max() for quality in qualities))


def _shortfall(qualities: Sequence[Quality], tolerance: float) -> float:
    """The mesh's error, all within the tolerance being the same."""
    return max(tolerance, _error(qualities))


def _climb(
    transcription: Transcription,
    guess: Sequence[PhaseTrajectory],
    parameters: Array | None,
    ladder: Sequence[dict[str, Any]],
    attempts: list[Attempt],
    options: dict[str, Any],
) -> Result:
    """Solve, with the ladder's other options where IPOPT fails; the first success, or the best."""
    best: Result | None = None
    for rung in ladder:
        tried = options | rung
        result = minimum(transcription, guess, parameters=parameters, **tried)
        attempts.append(
            Attempt(transcription.mesh.elements, tried, result.status, result.iterations)
        )
        if result.success:
            return result
        if best is None or _violation(result) < (1 - EQUAL) * _violation(best):
            best = result
    assert best is not None  # the ladder has rungs
    return best


def _require_ladder(ladder: Any, options: Mapping[str, Any]) -> None:
    """Refuse a ladder that is not a sequence of options, and options that IPOPT does not have."""
    if not isinstance(ladder, Sequence) or not all(isinstance(r, Mapping) for r in ladder):
        raise TypeError(f"ladder = {ladder!r}: must be a sequence of options, such as ({{}},)")
    if not ladder:
        raise ValueError("ladder: give at least one set of options, such as {}")
    for rung in (options, *ladder):
        require_options(rung)


def _again(
    transcription: Transcription, result: Result, attempts: list[Attempt], options: dict[str, Any]
) -> Result:
    """Solve near a result, on another mesh."""
    for barrier in WARM_BARRIERS:
        warm = {"mu_init": barrier} | options | {"max_iter": WARM_ITERATIONS}
        found = transcription.solve(result.phases, parameters=result.parameters, **warm)
        elements = transcription.mesh.elements
        attempts.append(Attempt(elements, warm, found.status, found.iterations))
        if found.success:
            break
    return found


def _dearer(result: Result, other: Result) -> bool:
    """Whether it costs so much more that it must be another optimum."""
    return result.cost - other.cost > SAME_COST * (1e-9 + abs(other.cost))


def _certified(
    transcription: Transcription,
    result: Result,
    tolerance: float,
    attempts: list[Attempt],
    options: dict[str, Any],
) -> tuple[Transcription, Result]:
    """Refine where the Hamiltonian is not constant; what is better by it, and the same optimum."""
    best = transcription, result
    spread = certificate(*best).hamiltonian_spread
    for _ in range(CERTIFYING_PASSES):
        mesh = certified(
            transcription.mesh, certificate(transcription, result).hamiltonian, tolerance
        )
        if mesh == transcription.mesh:
            break
        transcription = Transcription(transcription.problem, mesh)
        result = _again(transcription, result, attempts, options)
        if not result.success or _dearer(result, best[1]):
            break
        found = certificate(transcription, result).hamiltonian_spread
        if found < (1 - EQUAL) * spread:
            best, spread = (transcription, result), found
    return best


def _violation(result: Result) -> float:
    return result.breaches[0].amount if result.breaches else 0.0


def _within(
    sharper: tuple[Transcription, Result],
    plain: tuple[Transcription, Result],
    tolerance: float,
    options: dict[str, Any],
) -> tuple[Transcription, Result]:
    """The sharper of two solutions within its limits; the other where that costs clearly less.

    How much it costs to stay within limits depends on the mesh, where an optimal control switches.
    """
    transcription, before = sharper
    result = _backed_off(transcription, before, tolerance, options)
    inside = _overshoot(transcription, result) < tolerance
    if inside and not _dearer(result, before):
        return transcription, result
    other = _backed_off(*plain, tolerance, options)
    if not inside or (_overshoot(plain[0], other) < tolerance and _dearer(result, other)):
        return plain[0], other
    return transcription, result


def _backed_off(
    transcription: Transcription, result: Result, tolerance: float, options: dict[str, Any]
) -> Result:
    """Move path constraints inwards by what polynomials overshoot between the nodes.

    Where an optimal control switches they do a little, whatever the mesh.
    """
    problem = transcription.problem
    margins = [0.0 for _ in problem.phases]
    for _ in range(3):
        excess = [quality.path_violation.max(axis=0) for quality in _assess(transcription, result)]
        if max(e.max() for e in excess) < tolerance:
            break
        margins = [m + 1.2 * e for m, e in zip(margins, excess, strict=True)]
        warm = {"mu_init": WARM_BARRIERS[0]} | options
        tighter = transcription.solve(
            result.phases, tightened(problem, margins), result.parameters, **warm
        )
        if not tighter.success:
            break
        result = tighter
    return result


def _overshoot(transcription: Transcription, result: Result) -> float:
    return float(max(quality.path_violation.max() for quality in _assess(transcription, result)))


def tightened(problem: Problem, margins: Sequence[Array | float]) -> Problem:
    """`problem` with every phase's path bounds moved inwards by margins (m,)."""
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
