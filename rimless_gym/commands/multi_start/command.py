"""Look for the local optima of a problem from many starts; refine and verify the best of them.

The problem is what a function of a module returns. Ctrl-C keeps what was found, and the same
command goes on from there.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from trajopt.ocp.interrupted import Interrupted

from rimless_gym.command import INTERRUPTED
from rimless_gym.commands.commandline import Parser, terminated_like_ctrl_c, whole
from rimless_gym.commands.multi_start.named import problem_named
from rimless_gym.commands.multi_start.results import REPORT, SEARCH, write
from trajopt.ocp.guesses import Family, Waves, Waypoints
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import DEGREE, ELEMENTS, Search, best_of, multi_start

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
    parser.require_folder(options.out, SEARCH, REPORT)
    with parser.refusing():
        problem = problem_named(options.problem)
        mesh = Mesh.uniform(problem, options.elements, options.degree)
        family = FAMILIES[options.family](problem)
        path = options.out / SEARCH
        known = Search.load(path, problem, family) if path.exists() else None
    try:
        with parser.refusing(), terminated_like_ctrl_c():
            search = _searched(family, mesh, known, options)
    except KeyboardInterrupt:
        print("\ninterrupted: the same command goes on from here", file=sys.stderr)
        return INTERRUPTED
    print(search.report())
    best = best_of(search, options.best)
    write(search, best, options.out)
    print(*(extremal.report() for extremal in best), sep="\n")
    if not best:
        return 2
    return 0 if best[0].converged else 1


def _searched(
    family: Family, mesh: Mesh, known: Search | None, options: argparse.Namespace
) -> Search:
    """Search, going on from what an earlier search in the same folder found, and save it."""
    path = options.out / SEARCH
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
