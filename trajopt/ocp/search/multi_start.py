"""Multi-start: a problem has many local optima, and only trying finds the good ones.

Every start is solved once, on one coarse mesh that all of them share. That is quick, and it tells
good optima from bad ones. `best_of` refines and verifies the winners.
"""

from __future__ import annotations

import dataclasses
import math
from contextlib import closing
from typing import Any

from tqdm import tqdm

from trajopt.ocp.checks import flag, integer, require_callable, require_kind
from trajopt.ocp.interrupted import Interrupted
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.search.optima import Outcome, Same, StartFamily
from trajopt.ocp.search.search import Search
from trajopt.ocp.search.workers import outcomes_of
from trajopt.ocp.solving.runs import WARM_BARRIER
from trajopt.ocp.solving.solve import solve
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.options import require_options
from trajopt.processes import require_picklable

#: The mesh that starts share if no other is given: elements per phase and their degree.
ELEMENTS, DEGREE = 14, 4

#: Options over `options.IPOPT`: a start that takes longer seldom leads anywhere.
OPTIONS = {"max_iter": 300}


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
            options; starts that it has finished are not solved again.
        same: (outcome, outcome) -> whether they are the same optimum.
        progress: whether to show a bar.
        options: of IPOPT, over `OPTIONS`.

    Raises:
        Interrupted: Ctrl-C was pressed; its `partial` is the search so far.
        TypeError: an argument is of the wrong type.
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
    search = Search(problem, family, starts, seed, mesh, OPTIONS | options, same=same)
    earlier = () if known is None else _known(known, search)
    finished = {o.index: o for o in earlier if o.index < starts}
    missing = [index for index in range(starts) if index not in finished]
    if workers > 1:
        require_picklable("family", family)

    def so_far() -> Search:
        outcomes = tuple(outcome for _, outcome in sorted(finished.items()))
        return dataclasses.replace(search, outcomes=outcomes)

    best = min((o.cost for o in finished.values() if not o.failure), default=math.inf)
    work = outcomes_of(search, missing, max(1, min(workers, len(missing))))
    try:
        with (
            tqdm(total=starts, initial=len(finished), desc="starts", disable=not progress) as bar,
            closing(work) as outcomes,
        ):
            for outcome in outcomes:
                finished[outcome.index] = outcome
                if not outcome.failure:
                    best = min(best, outcome.cost)
                found = f"best cost {best:.6g}" if best < math.inf else "none found yet"
                bar.set_postfix_str(found, refresh=False)
                bar.update()
    except KeyboardInterrupt:
        raise Interrupted(so_far()) from None
    return so_far()


def best_of(search: Search, count: int = 1, **settings: Any) -> tuple[Extremal, ...]:
    """The best optima, refined and verified by `solve`, best first; failures come last.

    Args:
        search: what found them.
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
    ranked = least_first(refined, lambda e: e.cost)
    return tuple(sorted(ranked, key=lambda e: not e.converged))


def _known(known: Any, search: Search) -> tuple[Outcome, ...]:
    """The outcomes of an earlier search, if it is the same one.

    Raises:
        TypeError: it is not a search.
        ValueError: it is another search.
    """
    require_kind("known", known, Search)
    for name in ("seed", "mesh", "options"):
        mine, theirs = getattr(search, name), getattr(known, name)
        if mine != theirs:
            raise ValueError(f"known: its {name} is {theirs}, not {mine}; search anew")
    outcomes: tuple[Outcome, ...] = known.outcomes
    return outcomes
