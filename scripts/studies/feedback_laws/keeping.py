"""Cells measured side by side, each kept in a file as soon as it is finished."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, TypeAlias

from tqdm import tqdm

from scripts.studies.feedback_laws.cells import Cell
from trajopt.files import jsonable, read_signed, write_signed
from trajopt.processes import pool

#: (cell, file of its gait) -> {"found": figures, "seconds": of measuring}, or {"error": words}
Measure: TypeAlias = Callable[[Cell, Path], dict[str, Any]]

#: The time that is left follows from the time that each cell takes, about.
BAR = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}, {remaining} left{postfix}"


def completed(
    folder: Path,
    name: str,
    cells: Sequence[Cell],
    gaits: Mapping[str, Path],
    measure: Measure,
    workers: int,
) -> dict[Cell, dict[str, Any]]:
    """What is known of the cells after all have been measured, those kept before included.

    A cell with an error is not kept, and measured again the next time.

    Args:
        folder: of the results.
        name: of this part of the study, for the progress bar.
        cells: of the study.
        gaits: files by key.
        measure: a function at the top of a module.
        workers: processes; one works in this process.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made_of = {cell: cell.made_of(gaits[cell.gait]) for cell in cells}
    found = {c: kept for c in cells if (kept := _kept(folder, c, made_of[c])) is not None}
    todo = [cell for cell in cells if cell not in found]
    with tqdm(total=sum(c.seconds for c in todo), desc=name, bar_format=BAR) as bar:
        bar.set_postfix_str(f"{len(found)}/{len(cells)} cells")
        for cell, each in _measured(todo, gaits, measure, workers):
            found[cell] = each
            if "error" not in each:
                write_signed(_file(folder, cell), {"made_of": made_of[cell], **each})
            bar.set_postfix_str(f"{len(found)}/{len(cells)} cells", refresh=False)
            bar.update(cell.seconds)
    return {cell: dict(jsonable(found[cell])) for cell in cells}


def _measured(
    cells: Sequence[Cell], gaits: Mapping[str, Path], measure: Measure, workers: int
) -> Iterator[tuple[Cell, dict[str, Any]]]:
    if workers == 1 or len(cells) <= 1:
        for cell in cells:
            yield cell, measure(cell, gaits[cell.gait])
        return
    with pool(workers) as submit:
        futures = {submit(measure, cell, gaits[cell.gait]): cell for cell in cells}
        for future in as_completed(futures):
            yield futures[future], future.result()


def _kept(folder: Path, cell: Cell, made_of: str) -> dict[str, Any] | None:
    """A cell's result, unless it is missing, damaged, edited or out of date."""
    path = _file(folder, cell)
    if not path.exists():
        return None
    try:
        values = read_signed(path)
    except ValueError as error:
        tqdm.write(f"{error}; it is measured again", file=sys.stderr)
        return None
    return values if values.pop("made_of") == made_of else None


def _file(folder: Path, cell: Cell) -> Path:
    return folder / f"{cell.key}.json"
