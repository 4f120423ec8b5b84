"""Solve a problem: discretise, refine until it is accurate, verify."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from trajopt.ocp.arrays import Array
from trajopt.ocp.checks import flag, integer, positive, require_kind
from trajopt.ocp.interrupted import heeded
from trajopt.ocp.judge.accuracy import audit
from trajopt.ocp.judge.candidate import Candidate
from trajopt.ocp.judge.resimulation import resimulated
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.solving.guesses import straight_lines
from trajopt.ocp.solving.margins import within_limits
from trajopt.ocp.solving.refinement import Tolerances, certified, refined
from trajopt.ocp.solving.runs import LADDER, Runs, require_ladder
from trajopt.ocp.solving.ties import clearly_smaller, no_larger
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import Transcription
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Most refinements for the sake of the Hamiltonian.
CERTIFYING_PASSES = 5


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
        cost_tolerance: of the cost's error, and of what the control may cost too much, within an
            element, relative to 1 + |cost|; only guides the refinement.
        limit_tolerance: of bounds and path constraints between the nodes.
        hamiltonian_tolerance: of the Hamiltonian's change over an element, relative; elements that
            exceed it are halved a few times, for as long as that helps.
        passes: most refinements; 0 solves on `mesh` alone.
        verify: whether to play the solution back; without, its `cost` is the transcription's.
        ladder: options of IPOPT tried one after the other, over `options`; ``({},)`` tries once.
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
        positive("tolerance", tolerance),
        positive("cost_tolerance", cost_tolerance),
        positive("limit_tolerance", limit_tolerance),
        positive("hamiltonian_tolerance", hamiltonian_tolerance),
    )
    passes, verify = integer("passes", passes, 0), flag("verify", verify)
    require_ladder(ladder, options)
    if transcription is not None:
        require_kind("transcription", transcription, Transcription)
    if isinstance(guess, Extremal):
        guess = guess.phases
    guess = straight_lines(problem) if guess is None else guess
    if transcription is None:
        mesh = Mesh.uniform(problem) if mesh is None else mesh
        transcription = Transcription(problem, mesh)
    runs = Runs(options)
    found = runs.climb(transcription.posed(problem), guess, parameters, ladder)
    found = _refined(found, tolerances, passes, runs)
    if passes and found.result.success:
        sharper = _certified(found, tolerances.hamiltonian, runs)
        found = within_limits(sharper, found, tolerances.limits, options)
    result = found.result
    return Extremal(
        problem=problem,
        mesh=found.transcription.mesh,
        phases=result.phases,
        parameters=result.parameters,
        tolerance=tolerances.states,
        limit_tolerance=tolerances.limits,
        transcribed_cost=result.cost,
        mesh_error=found.error,
        status=result.status,
        attempts=tuple(runs.attempts),
        breaches=result.breaches,
        audit=audit(problem, result.phases, result.parameters),
        certificate=found.certificate,
        resimulation=resimulated(problem, result.phases, result.parameters) if verify else None,
    )


def _refined(first: Candidate, tolerances: Tolerances, passes: int, runs: Runs) -> Candidate:
    """Refine the mesh until it meets the tolerances, or that no longer helps; the best solution."""
    best = current = first
    for _ in range(passes):
        result, transcription = current.result, current.transcription
        if not result.success:
            break
        problem, mesh = transcription.problem, transcription.mesh
        finer = refined(
            mesh, problem, result.phases, result.parameters, current.qualities, tolerances
        )
        if finer == mesh:
            break
        current = runs.again(Transcription(problem, finer), result)
        accurate = best.error <= tolerances.states
        if not current.result.success or (accurate and current.dearer_than(best)):
            break
        # All errors within the tolerance are the same.
        if no_larger(max(tolerances.states, current.error), max(tolerances.states, best.error)):
            best = current
    return best


def _certified(first: Candidate, tolerance: float, runs: Runs) -> Candidate:
    """Refine where the Hamiltonian is not constant; the solution at which it varies least."""
    best = current = first
    for _ in range(CERTIFYING_PASSES):
        transcription = current.transcription
        mesh = certified(transcription.mesh, current.certificate.hamiltonian, tolerance)
        if mesh == transcription.mesh:
            break
        current = runs.again(Transcription(transcription.problem, mesh), current.result)
        if not current.result.success or current.dearer_than(best):
            break
        spreads = current.certificate.hamiltonian_spread, best.certificate.hamiltonian_spread
        if clearly_smaller(*spreads):
            best = current
    return best
