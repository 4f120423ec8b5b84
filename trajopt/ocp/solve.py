"""Solve a problem: discretise it, refine the mesh until it is accurate enough, verify the solution.

IPOPT stops wherever the first-order conditions hold. That is a saddle or a maximum if the guess
lies there by symmetry. And where a cost falls for ever, but ever more slowly, the conditions hold
at any values that are large enough. `minimize` detects both.
"""

from __future__ import annotations

import dataclasses
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rimless_gym.checks import integer, positive, require_kind
from trajopt.ocp.accuracy import Candidate
from trajopt.ocp.arrays import Array
from trajopt.ocp.certificate import limits_on_grid
from trajopt.ocp.constraints import Constraint, InfeasibleBoundsError, pair
from trajopt.ocp.extremal import Attempt, Extremal
from trajopt.ocp.guesses import straight_lines
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.ranking import clearly_smaller, no_larger
from trajopt.ocp.refinement import Tolerances, certified, refined
from trajopt.ocp.resimulation import resimulate
from trajopt.ocp.scaling import Scales
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import DIVERGING, Result, Transcription, interruptible

#: Sets of IPOPT's options that are tried one after the other where IPOPT fails.
OPTION_SETS: tuple[dict[str, Any], ...] = (
    {},
    {"mu_strategy": "adaptive"},
    {"mu_init": 1.0, "bound_push": 0.1, "bound_frac": 0.1},
    {"mu_strategy": "adaptive", "nlp_scaling_method": "none", "max_iter": 1500},
)

#: IPOPT's first barrier for a warm start. It is small, so that the run does not leave for another
#: optimum. On a finer mesh the second is tried where the first fails.
WARM_BARRIER, WARM_BARRIERS = 1e-4, (1e-4, 1e-6)
WARM_ITERATIONS = 150

#: Most refinements for the sake of the Hamiltonian.
CERTIFYING_PASSES = 5

#: By how much a guess is moved away from a possible saddle, relative to scale + largest value.
NUDGE = 1e-2

#: If a solution's scales differ from its guess's by more than this, it is solved again in its own.
OTHER_SCALES = 30.0

#: If a value exceeds `LARGE` of its scale, the problem is solved again, its tolerance multiplied
#: by `FINER`; values that then grow by the factor `GROWN` have no limit.
LARGE, FINER, GROWN = 1e4, 1e-4, 2.0

#: Larger values, and costs below minus the second, occur only where the cost has no minimum.
HUGE_VALUE, HUGE_COST = 1e10, 1e20

#: How often limits are moved inwards at most, and by what multiple of the overshoot.
MARGIN_PASSES, SAFETY = 3, 1.2


@interruptible()
def solve(
    problem: Problem,
    guess: Sequence[PhaseTrajectory] | Extremal | None = None,
    mesh: Mesh | None = None,
    *,
    parameters: Array | None = None,
    tolerance: float = 1e-7,
    hamiltonian_tolerance: float = 1e-3,
    passes: int = 20,
    verify: bool = True,
    option_sets: Sequence[dict[str, Any]] = OPTION_SETS,
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
        hamiltonian_tolerance: of the Hamiltonian's change over an element, relative; elements that
            exceed it are halved a few times, for as long as that helps.
        passes: most refinements; 0 solves on `mesh` alone.
        verify: whether to simulate the solution; without, its `cost` is the transcription's.
        option_sets: sets of IPOPT's options tried one after the other, over `options`; ``({},)``
            tries once.
        transcription: to begin with, of a problem that differs from this one in numbers alone; its
            mesh is used in place of `mesh`. Made anew by default.
        options: of IPOPT; a small ``mu_init`` keeps a warm start near.

    Returns:
        The solution, whether it converged or not: see `Extremal.converged` and `report`.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of its range, does not fit the problem, or is an option that
            IPOPT does not have.
    """
    require_kind("problem", problem, Problem)
    tolerances = Tolerances(
        states=positive("tolerance", tolerance),
        hamiltonian=positive("hamiltonian_tolerance", hamiltonian_tolerance),
    )
    passes = integer("passes", passes, 0)
    if isinstance(guess, Extremal):
        guess = guess.phases
    guess = straight_lines(problem) if guess is None else guess
    if transcription is None:
        mesh = Mesh.uniform(problem) if mesh is None else mesh
        transcription = Transcription(problem, mesh)
    runs = IpoptRuns(options)
    best = runs.first_success(transcription.for_problem(problem), guess, parameters, option_sets)
    best = _in_own_scales(best, runs)
    best = _refine(best, tolerances, passes, runs)
    if passes and best.result.success:
        sharper = _certify(best, tolerances, runs)
        best = within_limits(sharper, best, tolerances.limits, options)
    result = best.result
    playable = result.status != DIVERGING and all(math.isfinite(v.amount) for v in best.limits)
    return Extremal(
        problem=problem,
        mesh=best.transcription.mesh,
        phases=result.phases,
        parameters=result.parameters,
        tolerance=tolerances.states,
        limit_tolerance=tolerances.limits,
        transcribed_cost=result.cost,
        mesh_error=best.error,
        status=result.status,
        attempts=tuple(runs.attempts),
        violations=result.violations,
        audit=best.limits,
        certificate=best.certificate,
        resimulation=resimulate(problem, result.phases, result.parameters, best.scales)
        if verify and playable
        else None,
    )


def _in_own_scales(first: Candidate, runs: IpoptRuns) -> Candidate:
    """The solution, solved again where the scales of its guess were far from its own."""
    ratios = np.log10(first.scales.flat / first.result.scales.flat)
    if not first.result.success or np.abs(ratios).max() < math.log10(OTHER_SCALES):
        return first
    again = runs.warm_start(first.transcription, first.result)
    return again if again.result.success else first


def _refine(first: Candidate, tolerances: Tolerances, passes: int, runs: IpoptRuns) -> Candidate:
    """Refine the mesh until it meets the tolerances, or that no longer helps; the best solution."""
    best = current = first
    for _ in range(passes):
        result, transcription = current.result, current.transcription
        if not result.success:
            break
        problem, mesh = transcription.problem, transcription.mesh
        finer = refined(
            *(mesh, problem, result.phases, result.parameters),
            *(current.scales.phases, current.qualities, current.certificate.switches, tolerances),
        )
        if finer == mesh:
            break
        current = runs.warm_start(Transcription(problem, finer), result)
        accurate = best.error <= tolerances.states
        if not current.result.success or (accurate and current.costs_more_than(best)):
            break
        if _as_accurate(current, best, tolerances):
            best = current
    return best


def _as_accurate(one: Candidate, other: Candidate, tolerances: Tolerances) -> bool:
    """Whether the mesh error is no larger; all errors within the tolerance are the same."""
    return no_larger(*(max(tolerances.states, each.error) for each in (one, other)))


def _certify(first: Candidate, tolerances: Tolerances, runs: IpoptRuns) -> Candidate:
    """Refine where the Hamiltonian is not constant; the solution at which it varies least."""
    best = current = first
    for _ in range(CERTIFYING_PASSES):
        transcription = current.transcription
        varies = current.certificate.hamiltonian, current.certificate.scales
        mesh = certified(transcription.mesh, *varies, tolerances.hamiltonian)
        if mesh == transcription.mesh:
            break
        current = runs.warm_start(Transcription(transcription.problem, mesh), current.result)
        if not current.result.success or current.costs_more_than(best):
            break
        spreads = current.certificate.hamiltonian_spread, best.certificate.hamiltonian_spread
        if clearly_smaller(*spreads) and _as_accurate(current, best, tolerances):
            best = current
    return best


# -- runs of IPOPT ------------------------------------------------------------------------------


class IpoptRuns:
    """Runs IPOPT, with the same options over its own, and logs every run in `attempts`."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self.options = dict(options)
        self.attempts: list[Attempt] = []

    def first_success(
        self,
        transcription: Transcription,
        guess: Sequence[PhaseTrajectory],
        parameters: Array | None,
        option_sets: Sequence[Mapping[str, Any]],
    ) -> Candidate:
        """Solve with one set of options after the other: the first success, or the best failure."""
        best: Result | None = None
        diverging = 0
        for each in option_sets:
            tried = {**self.options, **each}
            result = minimize(transcription, guess, parameters=parameters, **tried)
            self._log(transcription, tried, result)
            if result.success:
                return Candidate(transcription, result)
            diverging += result.status == DIVERGING
            if best is None or clearly_smaller(_violation(result), _violation(best)):
                best = result
            if diverging == 2:  # no other options would find a minimum
                break
        assert best is not None  # there is at least one set
        return Candidate(transcription, best)

    def warm_start(self, transcription: Transcription, near: Result) -> Candidate:
        """Solve near a result, on another mesh."""
        given = [self.options.get("mu_init", barrier) for barrier in WARM_BARRIERS]
        for barrier in dict.fromkeys(given):  # the same one twice fails twice
            warm = self.options | {"mu_init": barrier, "max_iter": WARM_ITERATIONS}
            result = transcription.solve(near.phases, parameters=near.parameters, **warm)
            self._log(transcription, warm, result)
            if result.success:
                break
        return Candidate(transcription, result)

    def _log(self, transcription: Transcription, options: dict[str, Any], result: Result) -> None:
        elements = transcription.mesh.elements
        self.attempts.append(Attempt(elements, options, result.status, result.iterations))


def _violation(result: Result) -> float:
    return result.violations[0].relative if result.violations else 0.0


def minimize(
    transcription: Transcription,
    guess: Sequence[PhaseTrajectory],
    problem: Problem | None = None,
    parameters: Array | None = None,
    **options: Any,
) -> Result:
    """Like `Transcription.solve`, but not for a saddle, nor for values on their way to infinity.

    The result's status is `DIVERGING` if the cost has no minimum.
    """
    result = transcription.solve(guess, problem, parameters, **options)
    if result.success and result.may_be_saddle:
        moved = _nudged(result.phases, result.scales)
        other = transcription.solve(moved, problem, result.parameters, **options)
        if other.cost < result.cost - 1e-6 * (result.scales.cost + abs(result.cost)):
            result = other
    if result.success and result.largest > LARGE:
        finer = options | {"tol": FINER * options.get("tol", 1e-8), "mu_init": 1e-8}
        again = transcription.solve(result.phases, problem, result.parameters, **finer)
        units = result.scales.of_unknowns(transcription.layout)
        if np.abs(again.unknowns / units).max() > GROWN * result.largest:
            result = dataclasses.replace(again, success=False, status=DIVERGING)
    if not result.success and (
        result.largest > HUGE_VALUE or -result.cost > HUGE_COST * result.scales.cost
    ):
        result = dataclasses.replace(result, status=DIVERGING)
    return result


def _nudged(phases: Sequence[PhaseTrajectory], scales: Scales) -> list[PhaseTrajectory]:
    """The phases, moved at random in the same way every time."""
    rng, moved = np.random.default_rng(0), []
    for phase, units in zip(phases, scales.phases, strict=True):
        changes = {}
        for name in ("states", "controls"):
            values = getattr(phase, name)
            size = NUDGE * (getattr(units, name) + np.abs(values).max(axis=(0, 1), initial=0.0))
            changes[name] = values + size * rng.normal(size=values.shape)
        moved.append(dataclasses.replace(phase, **changes))
    return moved


# -- limits between the nodes -------------------------------------------------------------------


def within_limits(
    sharper: Candidate, plain: Candidate, tolerance: float, options: Mapping[str, Any]
) -> Candidate:
    """The sharper of two solutions with margins; the plain one where that costs clearly less.

    Where an optimal control switches, polynomials overshoot a little whatever the mesh. Limits are
    therefore moved inwards by what they overshoot. What that costs depends on the mesh.
    """
    best = _backed_off(sharper, tolerance, options)
    inside = not _overshoots(best, tolerance)
    if inside and not best.costs_more_than(sharper):
        return best
    other = _backed_off(plain, tolerance, options)
    if not inside or (not _overshoots(other, tolerance) and best.costs_more_than(other)):
        return other
    return best


def _backed_off(candidate: Candidate, tolerance: float, options: Mapping[str, Any]) -> Candidate:
    """The solution with limits moved inwards by what it overshoots, as far as there is room."""
    transcription, problem = candidate.transcription, candidate.transcription.problem
    margins: dict[tuple[int, str], float] = defaultdict(float)
    for _ in range(MARGIN_PASSES):
        excess = _overshoots(candidate, tolerance)
        if not excess:
            break
        for limit, amount in excess.items():
            margins[limit] += SAFETY * amount
        warm = {"mu_init": WARM_BARRIERS[0], **options}
        try:
            tight = tightened(problem, margins)
        except InfeasibleBoundsError:
            break
        result = candidate.result
        result = transcription.solve(result.phases, tight, result.parameters, **warm)
        if not result.success:
            break
        candidate = Candidate(transcription, result)
    return candidate


def _overshoots(candidate: Candidate, tolerance: float) -> dict[tuple[int, str], float]:
    """How far limits are violated between the nodes, by the index of their phase, and name."""
    result, problem = candidate.result, candidate.transcription.problem
    found: dict[tuple[int, str], float] = {}
    each = zip(problem.phases, result.phases, candidate.scales.phases, strict=True)
    for i, (phase, trajectory, scales) in enumerate(each):
        for _, units, outside in limits_on_grid(phase, trajectory, result.parameters, scales):
            found |= {
                (i, name): unit * relative
                for (name, unit), relative in zip(
                    units.items(), outside.max(axis=(0, 1)).tolist(), strict=True
                )
                if tolerance < relative < math.inf
            }
    return found


def tightened(problem: Problem, margins: Mapping[tuple[int, str], float]) -> Problem:
    """The problem with limits moved inwards by margins, by the index of their phase, and name."""
    phases = []
    for i, phase in enumerate(problem.phases):
        names = phase.path.names if phase.path else ()
        of = {name: margins.get((i, name), 0.0) for name in (*phase.bounds, *names)}
        bounds = {name: _inwards(*pair(b), of[name]) for name, b in phase.bounds.items()}
        path = phase.path
        if path is not None:
            lower, upper = _inwards(path.lower, path.upper, np.array([of[n] for n in names]))
            path = Constraint(path.function, lower, upper, path.names)
        phases.append(dataclasses.replace(phase, bounds=bounds, path=path))
    return dataclasses.replace(problem, phases=tuple(phases))


def _inwards(lower: Any, upper: Any, margin: Any) -> Any:
    """Bounds moved inwards, at most to their middle."""
    width = upper - lower
    half = np.where(np.isfinite(width), 0.5 * width, np.inf)
    step = np.minimum(margin, half)
    return lower + step, upper - step
