"""The whole study: every cell, then the gaps to the optimum, then the tables."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.folder import sole_user
from agents.protocol import PROTOCOL, SHORT_PROTOCOL, Protocol
from rimless_gym.params import WheelParams
from scripts.studies import page
from scripts.studies.cells import Cell, Result, kept
from scripts.studies.optima import Optima
from scripts.studies.rows import LEARNED, Row
from scripts.studies.running import Failure, Run, completed, ran
from scripts.studies.summary import everywhere, lines, walks
from trajopt.files import jsonable, write_text
from trajopt.provenance import provenance


@dataclasses.dataclass(frozen=True)
class Study:
    """What is studied.

    Attributes:
        rows: all that may stand in the tables.
        seeds: of every row, 0, 1, ...
        params: the machine.
        protocol: by which policies are judged.
    """

    rows: tuple[Row, ...]
    seeds: int
    params: WheelParams
    protocol: Protocol = PROTOCOL

    def briefly(self) -> Study:
        """A trial that shows that everything runs."""
        brief = (dataclasses.replace(row, trial=row.trial.brief()) for row in self.rows)
        return dataclasses.replace(self, rows=tuple(brief), protocol=SHORT_PROTOCOL)

    def cells(self) -> list[Cell]:
        """Row by row."""
        return [
            Cell(row, seed, self.params, self.protocol)
            for row in self.rows
            for seed in range(self.seeds)
        ]


@dataclasses.dataclass(frozen=True)
class Found:
    """What a study found.

    Attributes:
        sections: of the page, by name.
        failures: what went wrong, by cell.
        unfinished: rows that are not in the tables, because seeds of theirs are missing.
    """

    sections: dict[str, str]
    failures: dict[str, Failure]
    unfinished: tuple[str, ...]


def run(
    study: Study, names: Sequence[str], folder: Path, workers: int, running: Run = ran
) -> Found:
    """Run the cells of some rows; tell of all rows of which every seed is finished.

    Everything is also written to results.json.

    Args:
        study: what is studied.
        names: of the rows to run. Others are only told of, if they were finished before.
        folder: of the study.
        workers: processes.
        running: what trains and judges a cell.

    Raises:
        ValueError: another process works in the folder, or a file in it is damaged or of another
            study.
        KeyboardInterrupt: somebody asked to stop; the same call goes on.
    """
    with sole_user(folder):
        wanted = [cell for cell in study.cells() if cell.row.name in names]
        others = [cell for cell in study.cells() if cell.row.name not in names]
        results, failures = completed(folder, wanted, workers, running)
        results |= {cell: result for cell in others if (result := kept(folder, cell))}
        results = {cell: results[cell] for cell in study.cells() if cell in results}
        whole = {row for row in study.rows if _count(row, results) == study.seeds}
        told = {cell: result for cell, result in results.items() if cell.row in whole}
        return _told(study, told, failures, folder, workers)


def _count(row: Row, results: dict[Cell, Result]) -> int:
    return sum(cell.row == row for cell in results)


def _told(
    study: Study,
    results: dict[Cell, Result],
    failures: dict[Cell, Failure],
    folder: Path,
    workers: int,
) -> Found:
    walking = [
        policy
        for cell, result in results.items()
        for policy in result.policies.values()
        if cell.row.table == LEARNED and walks(cell.row, policy)
    ]
    optima = Optima(study.params, walking, folder, workers)
    table, whole = lines(results, optima.gap), everywhere(results)
    finished = {cell.row.name for cell in results}
    found = Found(
        page.sections(table, whole),
        {cell.key: failure for cell, failure in failures.items()},
        tuple(row.name for row in study.rows if row.name not in finished),
    )
    written: dict[str, Any] = {
        "params": study.params.to_dict(),
        "lines": [dataclasses.asdict(line) | {"row": line.row.name} for line in table],
        "cells": {
            cell.key: dataclasses.asdict(result)
            | {"gaps": {k: optima.gap(each) for k, each in result.policies.items()}}
            for cell, result in results.items()
        },
        "failures": found.failures,
        "provenance": provenance(),
    }
    write_text(folder / "results.json", json.dumps(jsonable(written), indent=1) + "\n")
    return found
