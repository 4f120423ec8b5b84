"""Cells side by side, each kept as soon as it is finished."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from tqdm import tqdm

from scripts.studies.learning.cells import Cell, Result, keep, kept
from scripts.studies.learning.estimate import Estimate
from trajopt.processes import crew
from trajopt.provenance import provenance

#: Of one cell, in words: what went wrong. Other cells go on.
Failure: TypeAlias = str

#: (cell, folder of the study) -> what became of it; a function at the top of a module.
Run: TypeAlias = Callable[[Cell, Path], Result | Failure]

#: How often the bar shows the time (s).
TICK = 5.0

BAR = "{desc}: {n_fmt}/{total_fmt} cells |{bar}| {elapsed}{postfix}"


def ran(cell: Cell, folder: Path) -> Result | Failure:
    """Train and judge a cell; in words what went wrong, if something did."""
    try:
        return cell.run(folder)
    except (TypeError, ValueError, RuntimeError, ArithmeticError) as error:
        return f"{type(error).__name__}: {error}"


def completed(
    folder: Path, cells: Sequence[Cell], workers: int, run: Run = ran
) -> tuple[dict[Cell, Result], dict[Cell, Failure]]:
    """The results of all cells, those kept before included; and what went wrong with others.

    Args:
        folder: of the study.
        cells: of the study.
        workers: processes; one works in this process.
        run: trains and judges a cell.

    Raises:
        ValueError: a kept cell is damaged, or of another study.
        KilledError: the process of a cell was killed; the same call goes on.
        KeyboardInterrupt: somebody asked to stop; the same call goes on.
    """
    results = {cell: before for cell in cells if (before := kept(folder, cell)) is not None}
    revision, failures = provenance()["git_revision"], dict[Cell, Failure]()
    _tell_of_others(results, revision)
    todo = [cell for cell in cells if cell not in results]
    estimate = Estimate(todo, results, workers)
    with tqdm(total=len(cells), initial=len(results), desc="study", bar_format=BAR) as bar:
        for cell, found in _ran(todo, folder, workers, run, bar, estimate):
            if isinstance(found, Failure):
                failures[cell] = found
                tqdm.write(f"{cell.key}: {found}", file=sys.stderr)
            else:
                results[cell] = dataclasses.replace(found, revision=revision)
                keep(folder, cell, results[cell])
            estimate.finished(cell, results.get(cell))
            bar.update()
            bar.set_postfix_str(estimate.words)
    return {cell: results[cell] for cell in cells if cell in results}, failures


def _ran(
    cells: Sequence[Cell], folder: Path, workers: int, run: Run, bar: tqdm, estimate: Estimate
) -> Iterator[tuple[Cell, Result | Failure]]:
    bar.set_postfix_str(estimate.words)
    if workers == 1 or len(cells) <= 1:
        for cell in cells:
            yield cell, run(cell, folder)
        return
    left, by_key = list(cells), {cell.key: cell for cell in cells}
    with crew(workers) as at_work:
        while left or at_work.busy:
            for _ in range(min(at_work.free, len(left))):
                cell = left.pop(0)
                at_work.begin(cell.key, run, cell, folder)
            for key, found in at_work.done(TICK):
                yield by_key[key], found
            bar.set_postfix_str(estimate.words)


def _tell_of_others(results: dict[Cell, Result], revision: str | None) -> None:
    """Say which kept cells were judged by another revision of the code."""
    others = [cell.key for cell, result in results.items() if result.revision != revision]
    if others:
        tqdm.write(
            f"warning: {', '.join(others)}: made by another revision than {revision}; remove "
            "their folders to make them anew",
            file=sys.stderr,
        )
