"""One case solved from many starts, refined and simulated."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from scripts.studies.thesis.experiments.case import Case
from scripts.studies.thesis.experiments.replay import replayed, resampled
from scripts.studies.thesis.experiments.solved import Solved
from scripts.studies.thesis.experiments.starts import WaypointStarts
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome, Search, multi_start
from trajopt.ocp.problem import Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.ocp.trajectory import PhaseTrajectory

#: Costs that differ by less (relative, absolute) count as equal.
AS_GOOD = (1e-4, 1e-7)


def solved(case: Case, before: Solved | None = None) -> Solved:
    """Solve a case, and simulate what came out.

    Args:
        case: what to solve.
        before: the solution of `case.after`.

    Raises:
        RuntimeError: every start failed.
    """
    begin = time.perf_counter()
    problem = case.problem(before.extremal if before else None)
    family = case.family or partial(WaypointStarts, durations=case.effort.durations)
    search = multi_start(
        problem,
        family(problem),
        case.effort.starts,
        mesh=Mesh.uniform(problem, case.effort.elements),
        same=same,
    )
    if not search.optima:
        raise RuntimeError(f"experiment {case.experiment}, {case.variant}: {search.report()}")
    best = _best(search, case.quickest)
    extremal = solve(
        of_durations(problem, best.phases) if case.quickest else problem,
        best.phases,
        search.mesh,
        parameters=best.parameters,
        tolerance=case.effort.tolerance,
        mu_init=WARM_BARRIER,
    )
    return Solved(
        key=case.key,
        extremal=extremal,
        optima=tuple((o.cost, len(o.starts), _duration(o.best)) for o in search.optima),
        failed=len(search.failures),
        reaching=len(search.optima[0].starts),
        **simulated(case, extremal, before),
        seconds=time.perf_counter() - begin,
    )


def simulated(case: Case, extremal: Extremal, before: Solved | None) -> dict[str, Any]:
    """A case's motion and its simulations: the fields of `Solved` of these names."""
    motion = extremal.phases
    if before and case.appended:
        motion = before.motion + motion
    machine = case.machine(extremal.parameters)
    return {
        "motion": motion,
        "simulated": replayed(machine, motion),
        "resampled": resampled(machine, motion),
    }


def same(one: Outcome, other: Outcome) -> bool:
    """Whether two outcomes cost the same; then they count as one optimum."""
    relative, absolute = AS_GOOD
    return math.isclose(one.cost, other.cost, rel_tol=relative, abs_tol=absolute)


def _best(search: Search, quickest: bool) -> Outcome:
    """The best outcome; if `quickest`, the shortest of those that cost the same."""
    best = search.optima[0]
    if not quickest:
        return best.best
    return least_first((o for o in search.outcomes if o.index in best.starts), _duration)[0]


def of_durations(problem: Problem, phases: Sequence[PhaseTrajectory]) -> Problem:
    """The problem with durations fixed to a solution's.

    Where many durations cost the same, a solver would drift from one to another.
    """
    pairs = zip(problem.phases, phases, strict=True)
    fixed = [dataclasses.replace(phase, duration=found.duration) for phase, found in pairs]
    return dataclasses.replace(problem, phases=tuple(fixed))


def _duration(outcome: Outcome) -> float:
    return sum(phase.duration for phase in outcome.phases)
