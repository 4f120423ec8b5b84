#!/usr/bin/env python
"""Solve the thesis's six experiments; write results.json and a report with its figures redrawn.

With --prototype, settle instead whether the machine as built can walk: it takes half an hour, shows
how far it is, and when it is interrupted goes on from there the next time.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tqdm import tqdm

from trajopt.experiments import document, report
from trajopt.experiments.cases import EXPERIMENTS, every_case
from trajopt.experiments.run import Solved, run
from trajopt.prototype import page
from trajopt.prototype.study import Point, ends, improved, shared, study
from trajopt.prototype.variant import SCALES, VARIANTS

#: Of improvement, at most.
SWEEPS = 2


def main() -> int:
    """Run the command line; 0 if every case converged, 1 if not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--experiment", type=int, choices=EXPERIMENTS, help="one of them; all by default"
    )
    what.add_argument(
        "--prototype", action="store_true", help="the machine as built, in place of the experiments"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/thesis"), help="folder to write to")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--docs", type=Path, help="a page, docs/thesis.md, to put the table and figures into"
    )
    options = parser.parse_args()
    if options.prototype:
        return _prototype(options.out / "prototype", options.workers, options.docs)
    numbers = [options.experiment] if options.experiment else list(EXPERIMENTS)
    begin = time.perf_counter()
    solutions = _solutions(numbers, options.workers)
    report.write(solutions, options.out)
    if options.docs:
        document.refresh(options.docs, solutions)
    for solution in solutions:
        print(_line(solution))
    seconds = time.perf_counter() - begin
    print(f"{len(solutions)} problems in {seconds:.0f} s: see {options.out / 'report.html'}")
    return 0 if all(solution.converged for solution in solutions) else 1


def _prototype(folder: Path, workers: int, docs: Path | None) -> int:
    """Find the gaits, or go on finding them; 0 unless interrupted."""
    try:
        points = _points(folder, workers)
    except KeyboardInterrupt:
        print(f"\ninterrupted: what was found is in {folder}; the same command goes on from there")
        return 130
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
    with tqdm(total=len(VARIANTS) * len(SCALES), desc="searching") as bar:
        for point in study(folder, workers=workers):
            points.append(point)
            bar.set_postfix_str(f"{point.variant.name}, scale {point.scale:g}", refresh=False)
            bar.update()
    for sweep in range(1, SWEEPS + 1):
        better = 0
        with tqdm(total=len(points), desc=f"improving, sweep {sweep} of {SWEEPS}") as bar:
            after = []
            for point, changed in improved(folder, points, workers=workers):
                after.append(point)
                better += changed
                bar.set_postfix_str(f"{better} better", refresh=False)
                bar.update()
        points = after
        if not better:
            break
    order = {variant.name: i for i, variant in enumerate(VARIANTS)}
    return shared(sorted(points, key=lambda p: (order[p.variant.name], -p.scale)))


def _solutions(numbers: list[int], workers: int) -> list[Solved]:
    """In the order of the thesis."""
    order = [case.key for case in every_case() if case.experiment in numbers]
    solutions = []
    with tqdm(total=len(order), desc="problems") as bar:
        for solution in run(numbers, workers):
            solutions.append(solution)
            bar.set_postfix_str(f"experiment {solution.key[0]}, {solution.key[1]}", refresh=False)
            bar.update()
    return sorted(solutions, key=lambda solution: order.index(solution.key))


def _line(solution: Solved) -> str:
    printed = solution.case.printed[0]
    thesis = "-" if printed.cost is None else f"{printed.cost:.6f}"
    verdict = "converged" if solution.converged else "NOT CONVERGED"
    starts = f"{solution.reaching}/{solution.case.effort.starts} starts"
    return (
        f"{solution.key[0]}  {printed.variant:<44} cost {solution.extremal.cost:12.6f} "
        f"(thesis {thesis:>12})  {starts:<12}  {verdict}"
    )


if __name__ == "__main__":
    sys.exit(main())
