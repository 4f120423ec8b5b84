"""Multi-start: a problem has many local optima, and only trying finds the good ones.

Every start is solved once, on one coarse mesh that all of them share, which is quick and tells
good optima from bad ones; `best_of` refines and verifies the winners.
"""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from tqdm import tqdm

from rimless_gym.checks import flag, integer, require_callable, require_kind
from trajopt.files import (
    array_of,
    phases_from_arrays,
    phases_to_arrays,
    read_arrays,
    require_names,
    write_arrays,
)
from trajopt.ocp.judge.extremal import Extremal
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.search.optima import Optimum, Outcome, Same, Start, StartFamily, distinct
from trajopt.ocp.solving.interrupted import Interrupted
from trajopt.ocp.solving.minimum import minimum
from trajopt.ocp.solving.solve import WARM_BARRIER, solve
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import Transcription
from trajopt.ocp.transcribe.options import require_options
from trajopt.processes import pool, require_picklable
from trajopt.provenance import provenance

FORMAT = "trajopt search 1"

#: Of the mesh that a problem's starts share, if no other is given.
ELEMENTS, DEGREE = 14, 4

#: IPOPT's, over `options.IPOPT`: a start that takes longer seldom leads anywhere.
OPTIONS = {"max_iter": 300}

#: Starts that another process has at a time: the one that it solves, and the next.
AHEAD = 2


class SearchFileError(ValueError):
    """A file is not a search that this version saved, or was edited or damaged since."""


@dataclasses.dataclass(frozen=True, repr=False)
class Search:
    """What a multi-start found; all starts if it was not interrupted.

    Attributes:
        problem: what was solved.
        family: of the starts.
        starts: asked for.
        seed: of the family.
        mesh: that all starts share.
        options: of IPOPT, over `options.IPOPT`.
        outcomes: of the starts that are finished, by index.
        same: when two of them are one optimum.
        provenance: versions and git revision.
    """

    problem: Problem
    family: StartFamily
    starts: int
    seed: int
    mesh: Mesh
    options: Mapping[str, Any]
    outcomes: tuple[Outcome, ...] = ()
    same: Same = Outcome.same_as
    provenance: dict[str, Any] = dataclasses.field(default_factory=provenance)

    def start(self, index: int) -> Start:
        """Start number `index`: the same one whenever it is asked for."""
        drawn = self.family(np.random.default_rng([self.seed, index]), index)
        if not isinstance(drawn, (Start, Sequence)):
            raise TypeError(f"family: gives {drawn!r}; must be a Start, or a trajectory per phase")
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

    @property
    def complete(self) -> bool:
        """Whether every start is finished."""
        return len(self.outcomes) == self.starts

    def __repr__(self) -> str:
        best = f"best cost {self.optima[0].cost:.6g}" if self.optima else "none found"
        return (
            f"Search({len(self.outcomes)} of {self.starts} starts, {len(self.optima)} local "
            f"optima, {best}, {len(self.failures)} failed)"
        )

    def report(self, most: int = 10) -> str:
        """The `most` best optima and the reasons of failure, as text."""
        most = integer("most", most, 0)
        done, optima = len(self.outcomes), self.optima
        lines = [f"Multi-start, {done} of {self.starts} starts (seed {self.seed})"]
        for optimum in optima[:most]:
            times, kind = len(optimum.found), optimum.best.kind
            lines.append(
                f"  cost {optimum.cost:<15.9g} from {times} start(s), {times / done:.1%}"
                + (f", {kind}" if kind else "")
            )
        if len(optima) > most:
            lines.append(f"  and {len(optima) - most} more, up to {optima[-1].cost:.9g}")
        if not optima:
            lines.append("  NO LOCAL OPTIMUM FOUND")
        reasons = collections.Counter(o.failure.split(":")[0] for o in self.failures)
        lines += [f"  {count} failed: {reason}" for reason, count in reasons.most_common()]
        return "\n".join(lines)

    def save(self, path: str | Path) -> None:
        """Write everything but the problem and the family, as `trajopt.files` does."""
        names = [f.name for f in dataclasses.fields(Outcome) if f.name not in _ARRAYS]
        header = {
            "starts": self.starts,
            "seed": self.seed,
            "mesh": dataclasses.asdict(self.mesh),
            "options": dict(self.options),
            "outcomes": [{name: getattr(o, name) for name in names} for o in self.outcomes],
            "provenance": self.provenance,
        }
        arrays: dict[str, Any] = {}
        for outcome in self.outcomes:
            prefix = f"start{outcome.index}_"
            arrays |= phases_to_arrays(outcome.phases, prefix)
            arrays[prefix + "parameters"] = outcome.parameters
        write_arrays(path, FORMAT, header, arrays)

    @classmethod
    def load(
        cls,
        path: str | Path,
        problem: Problem,
        family: StartFamily,
        same: Same = Outcome.same_as,
    ) -> Search:
        """Read what `save` wrote, of this problem and family: the file does not know them.

        Raises:
            FileNotFoundError: there is no such file.
            SearchFileError: it is not a search saved by this version, or was edited or damaged.
        """
        remedy = "search again"
        header, arrays = read_arrays(path, FORMAT, SearchFileError, remedy)
        try:
            return cls._from_file(header, arrays, problem, family, same)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise SearchFileError(f"{path}: no valid search ({error}); {remedy}") from error

    @classmethod
    def _from_file(
        cls,
        header: Mapping[str, Any],
        arrays: Mapping[str, Any],
        problem: Problem,
        family: StartFamily,
        same: Same,
    ) -> Search:
        outcomes, known = [], set[str]()
        for entry in header["outcomes"]:
            prefix = f"start{integer('index', entry['index'], 0)}_"
            phases = phases_from_arrays(arrays, prefix)
            sizes = [(p.states.shape[-1], p.controls.shape[-1]) for p in phases]
            if sizes != [(len(p.states), len(p.controls)) for p in problem.phases]:
                raise ValueError("a search of another problem")
            shape = (len(problem.parameters),)
            parameters = array_of(arrays, prefix + "parameters", shape)
            outcomes.append(Outcome(phases=phases, parameters=parameters, **entry))
            known |= {*phases_to_arrays(phases, prefix), prefix + "parameters"}
        require_names(arrays, known)
        return cls(
            problem=problem,
            family=family,
            starts=header["starts"],
            seed=header["seed"],
            mesh=Mesh.from_dict(header["mesh"]),
            options=header["options"],
            outcomes=tuple(outcomes),
            same=same,
            provenance=header["provenance"],
        )


#: Attributes of an outcome that a file keeps as arrays.
_ARRAYS = ("phases", "parameters")


def multi_start(
    problem: Problem,
    family: StartFamily,
    starts: int,
    *,
    seed: int = 0,
    workers: int = 1,
    mesh: Mesh | None = None,
    known: Search | None = None,
    same: Same = Outcome.same_as,
    progress: bool = False,
    **options: Any,
) -> Search:
    """Solve a problem from many starts, each once and on one mesh.

    The same seed gives the same starts, and the same results, whatever the number of workers.

    Args:
        problem: what to solve.
        family: (generator, index) -> a guess, or a `Start`; see `trajopt.ocp.solving.guesses`.
            With more than one worker it must be possible to pickle it.
        starts: how many.
        seed: of the generators.
        workers: processes, this one included.
        mesh: 14 elements of degree 4 per phase by default.
        known: an earlier search, perhaps interrupted, of the same problem, family, seed, mesh and
            options: what it has finished is not done again.
        same: when two outcomes are one optimum.
        progress: whether to show a bar.
        options: of IPOPT, over `OPTIONS`.

    Raises:
        Interrupted: Ctrl-C was pressed; its `partial` is the search so far.
        TypeError: an argument is of the wrong kind.
        ValueError: an argument is out of its range, `known` is another search, or IPOPT has no such
            option.
    """
    require_kind("problem", problem, Problem)
    starts, seed = integer("starts", starts, 0), integer("seed", seed, 0)
    workers, progress = integer("workers", workers, 1), flag("progress", progress)
    for name, function in (("family", family), ("same", same)):
        require_callable(name, function)
    require_options(options)
    mesh = Mesh.uniform(problem, ELEMENTS, DEGREE) if mesh is None else mesh
    require_kind("mesh", mesh, Mesh)
    if known is not None:
        require_kind("known", known, Search)
    search = Search(problem, family, starts, seed, mesh, OPTIONS | options, same=same)
    finished = {o.index: o for o in _outcomes(known, search) if o.index < starts}
    missing = (index for index in range(starts) if index not in finished)
    left = starts - len(finished)

    def so_far() -> Search:
        outcomes = tuple(outcome for _, outcome in sorted(finished.items()))
        return dataclasses.replace(search, outcomes=outcomes)

    if workers > 1:
        require_picklable("family", family)
    run = _in_turn if workers == 1 or left < 2 else partial(_shared_out, min(workers, left))
    best = min((o.cost for o in finished.values() if not o.failure), default=math.inf)
    try:
        with (
            tqdm(total=starts, initial=len(finished), desc="starts", disable=not progress) as bar,
            closing(run(search, missing)) as outcomes,
        ):
            for outcome in outcomes:
                finished[outcome.index] = outcome
                if not outcome.failure:
                    best = min(best, outcome.cost)
                bar.set_postfix_str(f"best cost {best:.6g}", refresh=False)
                bar.update()
    except KeyboardInterrupt:
        raise Interrupted(so_far()) from None
    return so_far()


def best_of(search: Search, count: int = 1, **settings: Any) -> tuple[Extremal, ...]:
    """The `count` best optima, refined and verified by `solve`, best first; failures come last.

    Args:
        search: what found them.
        count: how many, at most.
        settings: of `solve`, options of IPOPT included.

    Raises:
        TypeError: an argument is of the wrong kind.
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
    ranked = least_first(refined, lambda e: e.cost)
    return tuple(sorted(ranked, key=lambda e: not e.converged))


def _outcomes(known: Search | None, search: Search) -> tuple[Outcome, ...]:
    if known is None:
        return ()
    for name in ("seed", "mesh", "options"):
        mine, theirs = getattr(search, name), getattr(known, name)
        if mine != theirs:
            raise ValueError(f"known: its {name} is {theirs}, not {mine}; search anew")
    return known.outcomes


Outcomes: TypeAlias = Generator[Outcome, None, None]


class _Solver:
    """Solves a search's starts on one transcription."""

    def __init__(self, search: Search) -> None:
        self.search = search
        self.transcription = Transcription(search.problem, search.mesh)

    def outcome(self, index: int) -> Outcome:
        """Of start number `index`."""
        start = self.search.start(index)
        guess, parameters, iterations = start.guess, start.parameters, 0
        for problem in start.problems:
            result = minimum(self.transcription, guess, problem, parameters, **self.search.options)
            guess, parameters = result.phases, result.parameters
            iterations += result.iterations
        failure = "" if result.success else f"{result.status}: {result.worst}"
        found = result.cost, result.phases, result.parameters
        return Outcome(index, start.kind, *found, iterations, failure)


def _in_turn(search: Search, indices: Iterable[int]) -> Outcomes:
    solver = _Solver(search)
    yield from map(solver.outcome, indices)


def _shared_out(workers: int, search: Search, indices: Iterable[int]) -> Outcomes:
    """Outcomes as they come, from this process and others.

    This one works too, for the others take a second to begin.
    """
    remaining, solver = iter(indices), _Solver(search)
    others = workers - 1
    running: set[Future[Outcome]] = set()
    with pool(others, _start_worker, search) as submit:
        while True:
            ahead = AHEAD * others - len(running)
            running |= {submit(_work, index) for index in islice(remaining, ahead)}
            own = next(remaining, None)
            if own is not None:
                yield solver.outcome(own)
            elif not running:
                return
            patience = None if own is None else 0.0
            done, running = wait(running, patience, FIRST_COMPLETED)
            yield from (future.result() for future in done)


_worker: _Solver


def _start_worker(search: Search) -> None:
    global _worker
    _worker = _Solver(search)


def _work(index: int) -> Outcome:
    return _worker.outcome(index)
