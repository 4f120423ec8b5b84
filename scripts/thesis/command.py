"""Solve the thesis's six experiments; write results.json and a report with its figures redrawn.

With --prototype, settle instead whether the machine as built can walk: it takes half an hour, and
shows how far it is. What was interrupted goes on from there with the same command.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tqdm import tqdm

from scripts.commandline import INTERRUPTED, Parser, terminated_like_ctrl_c, whole
from scripts.thesis.experiments import document, kept, report
from scripts.thesis.experiments.cases import EXPERIMENTS
from scripts.thesis.experiments.run import Solved, needed, run
from scripts.thesis.prototype import page
from scripts.thesis.prototype.study import Point, ends, improved, shared, study
from scripts.thesis.prototype.variant import SCALES, VARIANTS

#: Of improvement, at most.
SWEEPS = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if every case converged, 1 if not, 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--experiment", type=int, choices=EXPERIMENTS, help="one of them; all by default"
    )
    what.add_argument(
        "--prototype", action="store_true", help="the machine as built, in place of the experiments"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/thesis"), help="folder to write to")
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--docs", type=Path, help="a page, docs/thesis.md, to put the table and figures into"
    )
    options = parser.parse_args(arguments)
    folder = options.out / ("prototype" if options.prototype else "unfinished")
    if options.prototype:
        parser.require_folder(folder, "results.json", "prototype.png")
    else:
        parser.require_folder(options.out, "results.json", "report.html")
        parser.require_folder(folder)
    if options.docs:
        place = page if options.prototype else document
        parser.require_page(options.docs, place.MARKS, place.WANTED)
        parser.require_folder(place.figures_of(options.docs), "results.json")
    numbers = [options.experiment] if options.experiment else list(EXPERIMENTS)
    try:
        with terminated_like_ctrl_c():
            if options.prototype:
                return _prototype(folder, options.workers, options.docs)
            return _experiments(numbers, options.out, folder, options.workers, options.docs)
    except KeyboardInterrupt:
        print(f"\ninterrupted: what was found is in {folder}; the same command goes on from there")
        return INTERRUPTED


def _experiments(
    numbers: Sequence[int], out: Path, unfinished: Path, workers: int, docs: Path | None
) -> int:
    """Solve them, or go on solving them."""
    begin = time.perf_counter()
    solutions = _solutions(numbers, unfinished, workers)
    report.write(solutions, out)
    if docs:
        document.refresh(docs, solutions)
    kept.forget(unfinished, needed(numbers))
    for solution in solutions:
        print(_line(solution))
    seconds = time.perf_counter() - begin
    print(f"{len(solutions)} problems in {seconds:.0f} s: see {out / 'report.html'}")
    return 0 if all(solution.converged for solution in solutions) else 1


def _solutions(numbers: Sequence[int], unfinished: Path, workers: int) -> list[Solved]:
    """In the order of the thesis; each is kept in a file as soon as it is there."""
    cases = needed(numbers)
    found = kept.recalled(unfinished, cases)
    with (
        tqdm(total=len(cases), initial=len(found), desc="problems") as bar,
        closing(run(numbers, workers, found)) as solutions,
    ):
        for solution in solutions:
            kept.store(unfinished, solution)
            found[solution.key] = solution
            bar.set_postfix_str(f"experiment {solution.key[0]}, {solution.key[1]}", refresh=False)
            bar.update()
    return [found[case.key] for case in cases if case.experiment in numbers]


def _prototype(folder: Path, workers: int, docs: Path | None) -> int:
    """Find the gaits, or go on finding them."""
    points = _points(folder, workers)
    found = page.results(points, ends(points))
    page.write(found, folder)
    if docs:
        page.refresh(docs, found, points)
    print(page.table(found))
    print(f"{len(points)} points: see {folder / 'prototype.png'}")
    return 0


def _points(folder: Path, workers: int) -> list[Point]:
    """Searched for from large pendulums down, then improved until nothing is."""
    points: list[Point] = []
    with (
        tqdm(total=len(VARIANTS) * len(SCALES), desc="searching") as bar,
        closing(study(folder, workers=workers)) as found,
    ):
        for point in found:
            points.append(point)
            bar.set_postfix_str(f"{point.variant.name}, scale {point.scale:g}", refresh=False)
            bar.update()
    for sweep in range(1, SWEEPS + 1):
        better = 0
        after = []
        with (
            tqdm(total=len(points), desc=f"improving, sweep {sweep} of {SWEEPS}") as bar,
            closing(improved(folder, points, workers=workers)) as others,
        ):
            for point, changed in others:
                after.append(point)
                better += changed
                bar.set_postfix_str(f"{better} better", refresh=False)
                bar.update()
        points = after
        if not better:
            break
    order = {variant.name: i for i, variant in enumerate(VARIANTS)}
    return shared(sorted(points, key=lambda p: (order[p.variant.name], -p.scale)))


def _line(solution: Solved) -> str:
    printed = solution.case.printed[0]
    thesis = "-" if printed.cost is None else f"{printed.cost:.6f}"
    verdict = "converged" if solution.converged else "NOT CONVERGED"
    starts = f"{solution.reaching}/{solution.case.effort.starts} starts"
    return (
        f"{solution.key[0]}  {printed.variant:<44} cost {solution.extremal.cost:12.6f} "
        f"(thesis {thesis:>12})  {starts:<12}  {verdict}"
    )
