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
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from trajopt.extremal import Extremal
from trajopt.guesses import Waves, Waypoints
from trajopt.interrupted import Interrupted
from trajopt.mesh import Mesh
from trajopt.problem import Problem
from trajopt.search import DEGREE, ELEMENTS, Search, best_of, multi_start

FAMILIES = {"waves": Waves, "waypoints": Waypoints}


def main() -> int:
    """Run the command line; 0 if the best optimum was verified, 1 if not, 2 if none was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument(
        "problem", nargs="?", default="trajopt.textbook:cart_pole", help="module:function"
    )
    parser.add_argument("--family", choices=FAMILIES, default="waypoints", help="of the guesses")
    parser.add_argument("--starts", type=int, default=200, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of the guesses")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--elements", type=int, default=ELEMENTS, help="per phase, of the search")
    parser.add_argument("--degree", type=int, default=DEGREE, help="of the elements")
    parser.add_argument("--best", type=int, default=2, help="how many to refine and verify")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/multi_start"), help="folder for the results"
    )
    options = parser.parse_args()
    module, _, function = options.problem.partition(":")
    problem: Problem = getattr(importlib.import_module(module), function)()
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        search = _searched(problem, options)
    except KeyboardInterrupt:
        print("\ninterrupted: the same command goes on from here", file=sys.stderr)
        return 130
    print(search.report())
    best = best_of(search, options.best)
    _write(search, best, options.out)
    print(*(extremal.report() for extremal in best), sep="\n")
    if not best:
        return 2
    return 0 if best[0].converged else 1


def _searched(problem: Problem, options: argparse.Namespace) -> Search:
    """The search, from where an earlier one in the same folder was interrupted."""
    path = options.out / "search.npz"
    family = FAMILIES[options.family](problem)
    known = Search.load(path, problem, family) if path.exists() else None
    begin = time.perf_counter()
    try:
        search = multi_start(
            problem,
            family,
            options.starts,
            seed=options.seed,
            workers=options.workers,
            mesh=Mesh.uniform(problem, options.elements, options.degree),
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
