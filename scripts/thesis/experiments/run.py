"""Cases solved from many starts, refined, simulated, and set beside what the thesis printed."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from types import MappingProxyType
from typing import Any

import numpy as np

from rimless_gym.params import WheelParams
from scripts.thesis.experiments.case import Case, Key
from scripts.thesis.experiments.cases import every_case
from scripts.thesis.experiments.verification import (
    Verification,
    energy,
    least_normal_force,
    resampled,
    sampled_times,
    verified,
)
from trajopt.ocp.pose.bounds import pair
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.search.multi_start import multi_start
from trajopt.ocp.search.optima import Outcome
from trajopt.ocp.search.search import Search
from trajopt.ocp.solving.guesses import Guess, Waypoints
from trajopt.ocp.solving.runs import WARM_BARRIER
from trajopt.ocp.solving.solve import solve
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory
from trajopt.processes import pool

#: What a converged case may be off by: the mesh, the states simulated, the touchdowns (s).
MESH_ERROR, STATE_ERROR, TIME_ERROR = 1e-7, 1e-6, 1e-8

#: Starts are as good as the best within this (relative, absolute).
AS_GOOD = (1e-4, 1e-7)


@dataclasses.dataclass(frozen=True)
class Starts(Waypoints):
    """Random waypoints, in durations of which short ones are as likely as long ones.

    Attributes:
        durations: least and most (s).
    """

    durations: tuple[float, float] = (0.2, 4.0)

    def __call__(self, rng: np.random.Generator, index: int) -> Guess:
        """Guess number `index`."""
        low, high = np.log(self.durations)
        pairs = zip(self.problem.phases, super().__call__(rng, index), strict=True)
        return tuple(
            _stretched(trajectory, np.clip(np.exp(rng.uniform(low, high)), *pair(phase.duration)))
            for phase, trajectory in pairs
        )


def _stretched(trajectory: PhaseTrajectory, duration: float) -> PhaseTrajectory:
    return dataclasses.replace(
        trajectory, edges=trajectory.edges * (duration / trajectory.duration)
    )


@dataclasses.dataclass(frozen=True)
class Solved:
    """A case and what became of it.

    Attributes:
        key: of the case.
        extremal: the best solution, refined.
        motion: its steps, those that it continues before them.
        optima: cost, number of starts, and duration (s) of the local optima, best first.
        failed: starts that led nowhere.
        reaching: starts that came to the best optimum.
        simulated: the motion under its own control.
        resampled: the motion as the thesis simulated it.
        seconds: that all this took.
    """

    key: Key
    extremal: Extremal
    motion: tuple[PhaseTrajectory, ...]
    optima: tuple[tuple[float, int, float], ...]
    failed: int
    reaching: int
    simulated: Verification
    resampled: Verification
    seconds: float

    @property
    def case(self) -> Case:
        """What was solved."""
        return case_of(self.key)

    @property
    def machine(self) -> WheelParams:
        """With what was chosen of it."""
        return self.case.machine(self.extremal.parameters)

    @property
    def energy(self) -> float:
        """The thesis's, over all steps (J)."""
        return energy(self.machine, self.motion)

    @property
    def converged(self) -> bool:
        """Whether it satisfies all that is asked for."""
        if not (self.extremal.converged and self.extremal.mesh_error <= MESH_ERROR):
            return False
        return bool(
            self.case.limit
            or (
                self.simulated.state_error <= STATE_ERROR
                and max(self.simulated.touchdown_time_errors) <= TIME_ERROR
            )
        )

    def rows(self) -> list[dict[str, Any]]:
        """As `results.json` has them: one for every time that the thesis prints it."""
        return [
            {
                "experiment": self.case.experiment,
                "variant": printed.variant,
                "thesis_cost": printed.cost,
                "cost": self.extremal.cost,
                "thesis_energy_J": printed.energy,
                "energy_J": self.energy,
                "thesis_touchdown_time_error": printed.late,
                **self._figures(),
            }
            for printed in self.case.printed
        ]

    @property
    def _played_back(self) -> float | None:
        played = self.extremal.resimulation
        return max(played.phase_errors) if played else None

    def _figures(self) -> dict[str, Any]:
        extremal, exact, coarse = self.extremal, self.simulated, self.resampled
        names = extremal.problem.parameters
        peak = max(np.abs(p.control(sampled_times(p))).max() for p in self.motion)
        return {
            "final_time": extremal.duration,
            "max_state_error": exact.state_error,
            "touchdown_time_error": _number(max(exact.touchdown_time_errors)),
            "min_normal_force_over_weight": least_normal_force(self.machine, self.motion),
            "peak_voltage": float(peak),
            "converged": self.converged,
            "starts": self.case.effort.starts,
            "starts_reaching_best": self.reaching,
            "starts_failed": self.failed,
            "local_optima": [list(optimum) for optimum in self.optima],
            "parameters": dict(zip(names, extremal.parameters.tolist(), strict=True)),
            "mesh_error": extremal.mesh_error,
            "played_back_error": self._played_back,
            "thesis_style_state_error": coarse.state_error,
            "thesis_style_touchdown_time_errors": [
                _number(e) for e in coarse.touchdown_time_errors
            ],
            "seconds": self.seconds,
        }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def solved(case: Case, before: Solved | None = None) -> Solved:
    """Solve a case, and simulate what came out.

    Args:
        case: what to solve.
        before: the solution of `case.after`.

    Raises:
        RuntimeError: no start led anywhere.
    """
    begin = time.perf_counter()
    problem = case.problem(before.extremal if before else None)
    search = multi_start(
        problem,
        case.family(problem) if case.family else Starts(problem, durations=case.effort.durations),
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
        optima=tuple((o.cost, len(o.found), _duration(o.best)) for o in search.optima),
        failed=len(search.failures),
        reaching=len(search.optima[0].found),
        **simulated(case, extremal, before),
        seconds=time.perf_counter() - begin,
    )


def simulated(case: Case, extremal: Extremal, before: Solved | None) -> dict[str, Any]:
    """A case's motion, simulated: what is not known yet of a `Solved`."""
    motion = extremal.phases
    if before and case.appended:
        motion = before.motion + motion
    machine = case.machine(extremal.parameters)
    return {
        "motion": motion,
        "simulated": verified(machine, motion),
        "resampled": resampled(machine, motion),
    }


def same(one: Outcome, other: Outcome) -> bool:
    """Whether two are equally good: then they count as one optimum."""
    relative, absolute = AS_GOOD
    return math.isclose(one.cost, other.cost, rel_tol=relative, abs_tol=absolute)


def _best(search: Search, quickest: bool) -> Outcome:
    """The best outcome, or the quickest of those as good."""
    best = search.optima[0]
    if not quickest:
        return best.best
    return least_first((o for o in search.outcomes if o.index in best.found), _duration)[0]


def of_durations(problem: Problem, phases: Sequence[PhaseTrajectory]) -> Problem:
    """With the durations of a solution: where many are as good, a solver would drift away."""
    pairs = zip(problem.phases, phases, strict=True)
    fixed = [dataclasses.replace(phase, duration=found.duration) for phase, found in pairs]
    return dataclasses.replace(problem, phases=tuple(fixed))


def _duration(outcome: Outcome) -> float:
    return sum(phase.duration for phase in outcome.phases)


def run(
    numbers: Sequence[int], workers: int = 1, known: Mapping[Key, Solved] = MappingProxyType({})
) -> Generator[Solved, None, None]:
    """Solve the cases of some experiments, and those that they continue; each as it is finished.

    Args:
        numbers: of the experiments.
        workers: processes.
        known: cases that are solved already, by key.
    """
    done = dict(known)
    missing = [case for case in needed(numbers) if case.key not in done]
    if workers == 1:
        for case in missing:
            done[case.key] = solved(case, done[case.after.key] if case.after else None)
            yield done[case.key]
        return
    running: set[Future[Solved]] = set()
    with pool(workers) as submit:
        while missing or running:
            for case in [c for c in missing if c.after is None or c.after.key in done]:
                missing.remove(case)
                before = done[case.after.key] if case.after else None
                running.add(submit(_solved, case.key, before))
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                found = future.result()
                done[found.key] = found
                yield found


def needed(numbers: Sequence[int]) -> list[Case]:
    """The cases of some experiments and those that they continue, in order."""
    keys = set()
    for case in reversed(every_case()):  # what a case continues comes before it
        if case.experiment in numbers or case.key in keys:
            keys |= {case.key} | ({case.after.key} if case.after else set())
    return [case for case in every_case() if case.key in keys]


def case_of(key: Key) -> Case:
    """The case of a key."""
    return next(case for case in every_case() if case.key == key)


def _solved(key: Key, before: Solved | None) -> Solved:
    """A case, which cannot be pickled, by its key."""
    return solved(case_of(key), before)
