"""Solve the experiments, or go on solving them; then write the report and the page."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from tqdm import tqdm

from scripts.studies.thesis.experiments import case_files, document, report
from scripts.studies.thesis.experiments.cases import needed
from scripts.studies.thesis.experiments.run import run
from scripts.studies.thesis.experiments.solved import Solved


def campaign(
    numbers: Sequence[int], out: Path, unfinished: Path, workers: int, docs: Path | None
) -> bool:
    """Solve some experiments and print a line for each of their cases.

    Args:
        numbers: of the experiments.
        out: folder of the report.
        unfinished: folder in which solved cases are kept until all are.
        workers: processes.
        docs: page to put the tables and figures into, if any.

    Returns:
        Whether every case converged.
    """
    begin = time.perf_counter()
    solutions = _solutions(numbers, unfinished, workers)
    report.write(solutions, out)
    if docs:
        document.refresh(docs, solutions)
    case_files.forget(unfinished, needed(numbers))
    for solution in solutions:
        print(_line(solution))
    seconds = time.perf_counter() - begin
    print(f"{len(solutions)} problems in {seconds:.0f} s: see {out / 'report.html'}")
    return all(solution.converged for solution in solutions)


def _solutions(numbers: Sequence[int], unfinished: Path, workers: int) -> list[Solved]:
    """In the order of the thesis; each is kept in a file as soon as it is solved."""
    cases = needed(numbers)
    found = case_files.recalled(unfinished, cases)
    with (
        tqdm(total=len(cases), initial=len(found), desc="problems") as bar,
        closing(run(numbers, workers, found)) as solutions,
    ):
        for solution in solutions:
            case_files.store(unfinished, solution)
            found[solution.key] = solution
            bar.set_postfix_str(f"experiment {solution.key[0]}, {solution.key[1]}", refresh=False)
            bar.update()
    return [found[case.key] for case in cases if case.experiment in numbers]


def _line(solution: Solved) -> str:
    printed = solution.case.printed[0]
    thesis = "-" if printed.cost is None else f"{printed.cost:.6f}"
    verdict = "converged" if solution.converged else "NOT CONVERGED"
    starts = f"{solution.reaching}/{solution.case.effort.starts} starts"
    return (
        f"{solution.key[0]}  {printed.variant:<44} cost {solution.extremal.cost:12.6f} "
        f"(thesis {thesis:>12})  {starts:<12}  {verdict}"
    )
