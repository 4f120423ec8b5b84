#!/usr/bin/env python
"""Look for the local optima of a problem from many starts; refine and verify the best of them.

The problem is what a function of a module returns. Ctrl-C keeps what was found: the same command
goes on from there.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.commandline import INTERRUPTED, Parser, terminated_like_ctrl_c, whole
from trajopt.ocp.interrupted import Interrupted
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.search.multi_start import DEGREE, ELEMENTS, best_of, multi_start
from trajopt.ocp.search.search import Search
from trajopt.ocp.solving.guesses import Family, Waves, Waypoints
from trajopt.ocp.transcribe.mesh import Mesh

FAMILIES: dict[str, type[Family]] = {"waves": Waves, "waypoints": Waypoints}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if the best optimum was verified, 1 if not, 2 if none was found."""
    parser = Parser(__doc__)
    parser.add_argument(
        "problem", nargs="?", default="trajopt.ocp.textbook:cart_pole", help="module:function"
    )
    parser.add_argument("--family", choices=FAMILIES, default="waypoints", help="of the guesses")
    parser.add_argument("--starts", type=whole(1), default=200, help="how many")
    parser.add_argument("--seed", type=whole(0), default=0, help="of the guesses")
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument("--elements", type=whole(1), default=ELEMENTS, help="per phase")
    parser.add_argument("--degree", type=whole(1), default=DEGREE, help="of the elements")
    parser.add_argument("--best", type=whole(0), default=2, help="how many to refine and verify")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/multi_start"), help="folder for the results"
    )
    options = parser.parse_args(arguments)
    parser.require_folder(options.out, "search.npz", "report.txt")
    with parser.refusing():
        problem = _problem(options.problem)
        mesh = Mesh.uniform(problem, options.elements, options.degree)
        family = FAMILIES[options.family](problem)
        path = options.out / "search.npz"
        known = Search.load(path, problem, family) if path.exists() else None
    try:
        with parser.refusing(), terminated_like_ctrl_c():
            search = _searched(family, mesh, known, options)
    except KeyboardInterrupt:
        print("\ninterrupted: the same command goes on from here", file=sys.stderr)
        return INTERRUPTED
    print(search.report())
    best = best_of(search, options.best)
    _write(search, best, options.out)
    print(*(extremal.report() for extremal in best), sep="\n")
    if not best:
        return 2
    return 0 if best[0].converged else 1


def _problem(name: str) -> Problem:
    """What a function of a module, module:function, returns.

    Raises:
        ValueError: there is no such thing, or it returns something else.
    """
    module, _, function = name.partition(":")
    try:
        make = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"{name!r}: no such module:function can be imported ({error})") from error
    problem = make() if callable(make) else make
    if not isinstance(problem, Problem):
        raise ValueError(f"{name!r}: gives {type(problem).__name__}, not a trajopt.Problem")
    return problem


def _searched(
    family: Family, mesh: Mesh, known: Search | None, options: argparse.Namespace
) -> Search:
    """The search, from where an earlier one in the same folder was interrupted."""
    path = options.out / "search.npz"
    begin = time.perf_counter()
    try:
        search = multi_start(
            family.problem,
            family,
            options.starts,
            seed=options.seed,
            workers=options.workers,
            mesh=mesh,
            known=known,
            progress=True,
        )
    except Interrupted as stopped:
        stopped.partial.save(path)
        raise
    search.save(path)
    done = len(search.outcomes) - (len(known.outcomes) if known else 0)
    print(f"{done} starts in {time.perf_counter() - begin:.1f} s, {options.workers} worker(s)")
    return search


def _write(search: Search, best: tuple[Extremal, ...], folder: Path) -> None:
    """The report, figures, trajectories and pictures of the best."""
    reports = [search.report(), *(extremal.report() for extremal in best)]
    (folder / "report.txt").write_text("\n".join(reports) + "\n")
    for rank, extremal in enumerate(best, start=1):
        extremal.save(folder / f"best{rank}.npz")
        extremal.plot(folder / f"best{rank}.png")
        figures = json.dumps(extremal.to_dict(), indent=2)
        (folder / f"best{rank}.json").write_text(figures + "\n")


if __name__ == "__main__":
    sys.exit(main())
