"""Multi-start: a problem has many local optima, and only trying finds the good ones.

Every start is solved once, on one coarse mesh that all of them share. That is quick, and separates
good optima from bad ones. `best_of` refines and verifies the best.
"""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from functools import cached_property, lru_cache, partial
from typing import Any, TypeAlias, TypeVar

import cloudpickle
import numpy as np

from rimless_gym.checks import flag, integer, require_callable, require_kind
from trajopt.ocp.arrays import Array
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.scaling import Scales, scales_of
from trajopt.ocp.solve import WARM_BARRIER, minimize, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Transcription
from trajopt.pool import progress_bar, run

#: The mesh that starts share if no other is given: elements per phase and their degree.
ELEMENTS, DEGREE = 14, 4

#: Options over `trajopt.ocp.transcription.IPOPT`: a start that takes longer rarely leads anywhere.
OPTIONS = {"max_iter": 300}

#: Most optima in a report.
REPORTED = 10

#: By how much costs (relative, or else relative to their scale) and states along the phases (to
#: scale + magnitude) of one optimum may differ.
SAME_COST, SAME_SMALL_COST, SAME_STATES = 1e-4, 1e-9, 1e-2


@dataclasses.dataclass(frozen=True)
class Start:
    """A guess, and how to solve from it.

    Attributes:
        guess: one trajectory per phase.
        parameters: guess of the static parameters; the middle of their bounds by default.
        problems: what is solved, each from the solution of the one before, until one fails; by
            default the search's problem. They differ from it in numbers alone, and must be made
            from the copy that the family holds: then they share its functions in another process
            too.
        kind: of optimum ("2 turns"); optima of different kinds are different.
        options: of IPOPT, over the search's.
    """

    guess: Guess
    parameters: Array | None = None
    problems: tuple[Problem, ...] = ()
    kind: str = ""
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)


#: (generator, index) -> where start number `index` begins. Every start has a generator of its own.
StartFamily: TypeAlias = Callable[[np.random.Generator, int], Guess | Start]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How one start ended."""

    index: int  # of the start
    kind: str  # see `Start`
    cost: float  # the objective of the nonlinear program
    phases: tuple[PhaseTrajectory, ...]  # the last trajectory
    parameters: Array  # the static parameters
    iterations: int  # of IPOPT, for all of the start's problems
    failure: str  # in words; empty if it is a local optimum
    scales: Scales  # along the trajectory

    @cached_property
    def _samples(self) -> list[Array]:
        fractions = np.linspace(0.0, 1.0, 33)
        return [phase.state(phase.duration * fractions) for phase in self.phases]

    def same_as(self, other: Outcome) -> bool:
        """Whether both are the same optimum, as far as a coarse mesh can tell."""
        if self.kind != other.kind:
            return False
        tiny = SAME_SMALL_COST * self.scales.cost
        if not math.isclose(self.cost, other.cost, rel_tol=SAME_COST, abs_tol=tiny):
            return False
        mine, theirs = ([p.duration for p in o.phases] for o in (self, other))
        return np.allclose(mine, theirs, rtol=SAME_STATES) and all(
            np.all(np.abs(a - b) <= SAME_STATES * (unit.states + np.abs(a).max(axis=0)))
            for a, b, unit in zip(self._samples, other._samples, self.scales.phases, strict=True)
        )


Ranked = TypeVar("Ranked", Outcome, Extremal)

#: Whether two outcomes are one optimum.
Same: TypeAlias = Callable[[Outcome, Outcome], bool]


@dataclasses.dataclass(frozen=True)
class Optimum:
    """A local optimum, and the starts that led to it."""

    best: Outcome  # the outcome of least cost; the first of those that tie
    starts: tuple[int, ...]  # indices of all these starts, ascending

    @property
    def cost(self) -> float:
        """On the search's mesh."""
        return self.best.cost

    @property
    def phases(self) -> tuple[PhaseTrajectory, ...]:
        """The trajectory, on the search's mesh."""
        return self.best.phases


@dataclasses.dataclass(frozen=True, repr=False)
class Search:
    """Starts of a multi-start and what they led to.

    Attributes:
        problem: what was solved.
        family: of the starts.
        seed: of the family.
        mesh: that all starts share.
        options: of IPOPT, over `trajopt.ocp.transcription.IPOPT`.
        outcomes: of the starts, by index.
        same: (outcome, outcome) -> whether they are the same optimum.
        unit: what a report calls the cost, and by what it is divided there.
    """

    problem: Problem
    family: StartFamily
    seed: int
    mesh: Mesh
    options: Mapping[str, Any]
    outcomes: tuple[Outcome, ...] = ()
    same: Same = Outcome.same_as
    unit: tuple[str, float] = ("cost", 1.0)

    def start(self, index: int) -> Start:
        """Start number `index`, the same one every time."""
        drawn = self.family(np.random.default_rng([self.seed, index]), index)
        start = drawn if isinstance(drawn, Start) else Start(tuple(drawn))
        return dataclasses.replace(start, problems=start.problems or (self.problem,))

    @cached_property
    def optima(self) -> tuple[Optimum, ...]:
        """Different local optima, best first."""
        return distinct(self.outcomes, self.same)

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """The starts that led nowhere, by index."""
        return tuple(outcome for outcome in self.outcomes if outcome.failure)

    def report(self) -> str:
        """The best optima and the reasons of failure, as text."""
        count, optima = len(self.outcomes), self.optima
        name, unit = self.unit
        lines = [f"Multi-start, {count} starts (seed {self.seed})"]
        for optimum in optima[:REPORTED]:
            times, kind = len(optimum.starts), optimum.best.kind
            lines.append(
                f"  {name} {optimum.cost / unit:<15.9g} from {times} start(s), {times / count:.1%}"
                + (f", {kind}" if kind else "")
            )
        if len(optima) > REPORTED:
            lines.append(f"  and {len(optima) - REPORTED} more, up to {optima[-1].cost / unit:.9g}")
        if not optima:
            lines.append("  NO LOCAL OPTIMUM FOUND")
        reasons = collections.Counter(o.failure.split(":")[0] for o in self.failures)
        lines += [f"  {number} failed: {reason}" for reason, number in reasons.most_common()]
        return "\n".join(lines)


def multi_start(
    problem: Problem,
    family: StartFamily,
    starts: int,
    *,
    seed: int = 0,
    workers: int = 1,
    mesh: Mesh | None = None,
    same: Same = Outcome.same_as,
    unit: tuple[str, float] = ("cost", 1.0),
    earlier: Sequence[Outcome] = (),
    progress: bool = True,
    **options: Any,
) -> Search:
    """Solve a problem from many starts, each once and on one mesh.

    The same seed gives the same starts, and the same results, whatever the number of workers.

    Args:
        problem: what to solve.
        family: (generator, index) -> a guess, or a `Start`; see `trajopt.ocp.guesses`.
        starts: how many.
        seed: of the generators.
        workers: processes; with one, this process does the work.
        mesh: 14 elements of degree 4 per phase by default.
        same: (outcome, outcome) -> whether they are the same optimum.
        unit: what the bar and the report call the cost, and by what they divide it.
        earlier: outcomes of the first starts, which are not solved again.
        progress: whether to show a bar on a terminal, with the least cost and how often it was met.
        options: of IPOPT, over `OPTIONS`.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of its range, or IPOPT has no such option.
    """
    require_kind("problem", problem, Problem)
    starts, seed = integer("starts", starts, 0), integer("seed", seed, 0)
    workers, progress = integer("workers", workers, 1), flag("progress", progress)
    require_callable("family", family)
    mesh = Mesh.uniform(problem, ELEMENTS, DEGREE) if mesh is None else mesh
    require_kind("mesh", mesh, Mesh)
    search = Search(problem, family, seed, mesh, OPTIONS | options, same=same, unit=unit)
    solved = partial(_solved, cloudpickle.dumps(search))
    outcomes = {outcome.index: outcome for outcome in earlier}
    bar = progress_bar("starts", progress, total=starts, initial=len(outcomes))
    with closing(run(solved, range(len(outcomes), starts), workers)) as results, bar:
        for index, outcome in results:
            outcomes[index] = outcome
            for best in distinct(outcomes.values(), same)[:1]:
                bar.set_postfix_str(f"{unit[0]} {best.cost / unit[1]:.5g}, met {len(best.starts)}x")
            bar.update()
    return dataclasses.replace(search, outcomes=tuple(outcomes[i] for i in range(starts)))


def best_of(search: Search, count: int = 1, **settings: Any) -> tuple[Extremal, ...]:
    """The best optima, refined and verified by `solve`, best first; failures come last.

    Args:
        search: what to take them from.
        count: how many, at most.
        settings: of `solve`, options of IPOPT included.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of its range.
    """
    require_kind("search", search, Search)
    count = integer("count", count, 0)
    settings = {"mu_init": WARM_BARRIER} | settings
    refined = []
    for optimum in search.optima[:count]:
        problem = search.start(optimum.best.index).problems[-1]
        guess, parameters = optimum.phases, optimum.best.parameters
        refined.append(solve(problem, guess, search.mesh, parameters=parameters, **settings))
    return tuple(sorted(_best_first(refined), key=lambda e: not e.converged))


def distinct(outcomes: Iterable[Outcome], same: Same = Outcome.same_as) -> tuple[Optimum, ...]:
    """The different optima among the outcomes that are no failures, best first."""
    successes = [outcome for outcome in outcomes if not outcome.failure]
    groups: list[list[Outcome]] = []
    in_turn = sorted(successes, key=lambda o: o.index)
    for outcome in _best_first(in_turn):
        for group in groups:
            if same(group[0], outcome):
                group.append(outcome)
                break
        else:
            groups.append([outcome])
    return tuple(Optimum(g[0], tuple(sorted(o.index for o in g))) for g in groups)


def _best_first(found: Sequence[Ranked]) -> list[Ranked]:
    """In order of cost; the first of those that tie, relative to the cost's scale."""
    unit = max((each.scales.cost for each in found), default=1.0)
    return least_first(found, lambda each: each.cost / unit)


def _solved(pickled: bytes, index: int) -> Outcome:
    """Solve start number `index` of a search: its problems one after the other."""
    search, transcription = _transcribed(pickled)
    start = search.start(index)
    guess, parameters, iterations = start.guess, start.parameters, 0
    for problem in start.problems:
        options = {**search.options, **start.options}
        result = minimize(transcription, guess, problem, parameters, **options)
        guess, parameters = result.phases, result.parameters
        iterations += result.iterations
        if not result.success:
            break
    failure = "" if result.success else ": ".join([result.status, *map(str, result.violations[:1])])
    solution = result.cost, result.phases, result.parameters
    scales = scales_of(problem, *solution[1:])
    return Outcome(index, start.kind, *solution, iterations, failure, scales)


@lru_cache(maxsize=1)  # every process makes one transcription for all starts of a search
def _transcribed(pickled: bytes) -> tuple[Search, Transcription]:
    search = cloudpickle.loads(pickled)
    return search, Transcription(search.problem, search.mesh)
