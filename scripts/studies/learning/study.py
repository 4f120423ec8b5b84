"""The whole study: every cell, then the gaps to the optimum, then the tables."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.folder import sole_user
from agents.protocol import PROTOCOL, SHORT_PROTOCOL, Protocol
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import machine_name, preset
from scripts.studies.learning import page
from scripts.studies.learning.cells import Cell, Result, kept
from scripts.studies.learning.figures import Figures
from scripts.studies.learning.optima import Optima
from scripts.studies.learning.row import Row
from scripts.studies.learning.running import Failure, Run, completed, ran
from scripts.studies.learning.summary import everywhere, lines, one_by_one, walks
from trajopt.files import jsonable, write_text
from trajopt.provenance import provenance

#: A row appears in a table once this many seeds have finished.
FEWEST = 3


@dataclasses.dataclass(frozen=True)
class Study:
    """What is studied.

    Attributes:
        rows: all that may stand in the tables.
        seeds: of every row, 0, 1, ...
        params: the machine, where a row has none of its own.
        protocol: by which policies are judged.
    """

    rows: tuple[Row, ...]
    seeds: int
    params: WheelParams
    protocol: Protocol = PROTOCOL

    def briefly(self) -> Study:
        """A trial that shows that everything runs."""
        brief = tuple(row.brief() for row in self.rows)
        return dataclasses.replace(self, rows=brief, protocol=SHORT_PROTOCOL)

    def cells(self) -> list[Cell]:
        """Row by row."""
        return [
            Cell(row, seed, self.machine(row), self.protocol)
            for row in self.rows
            for seed in range(self.seeds)
        ]

    def machine(self, row: Row) -> WheelParams:
        """The machine of a row."""
        return self.params if row.machine is None else preset(row.machine)


@dataclasses.dataclass(frozen=True)
class Found:
    """What a study found.

    Attributes:
        sections: of the page, by name.
        failures: what went wrong, by cell.
        unfinished: rows of which seeds are missing in the tables, and how many there are.
    """

    sections: dict[str, str]
    failures: dict[str, Failure]
    unfinished: tuple[str, ...]


def run(
    study: Study, names: Sequence[str], folder: Path, workers: int, running: Run = ran
) -> Found:
    """Run the cells of some rows; tell of all rows of which enough first seeds are finished.

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
        told = {cell: results[cell] for row in study.rows for cell in _first(study, row, results)}
        return _told(study, told, failures, folder, workers)


def _first(study: Study, row: Row, results: dict[Cell, Result]) -> list[Cell]:
    """The first seeds of a row, up to one that is missing; none if they are too few.

    So a row says how many seeds it has, and nobody chose which.
    """
    own = [cell for cell in study.cells() if cell.row == row]
    finished = list(itertools.takewhile(lambda cell: cell in results, own))
    return finished if len(finished) >= min(FEWEST, study.seeds) else []


def _told(
    study: Study,
    results: dict[Cell, Result],
    failures: dict[Cell, Failure],
    folder: Path,
    workers: int,
) -> Found:
    walking: dict[WheelParams, list[Figures]] = {study.machine(row): [] for row in study.rows}
    for cell, result in results.items():
        if cell.row.trial.period == CONTROL_PERIOD:
            every = result.policies.values()
            walking[cell.params] += [policy for policy in every if walks(cell.row, policy)]
    optima = {params: Optima(params, own, folder, workers) for params, own in walking.items()}

    def gap(row: Row, of: Figures) -> float | None:
        """None where actions are held for another time than those of the optima."""
        return optima[study.machine(row)].gap(of) if row.trial.period == CONTROL_PERIOD else None

    table, whole = lines(results, gap), everywhere(results)
    counts = {row: sum(cell.row == row for cell in results) for row in study.rows}
    found = Found(
        page.sections(table, whole, one_by_one(results, gap)),
        {cell.key: failure for cell, failure in failures.items()},
        tuple(
            f"{row.name} ({count} of {study.seeds} seeds)"
            for row, count in counts.items()
            if count < study.seeds
        ),
    )
    written: dict[str, Any] = {
        "machines": {machine_name(params): params.to_dict() for params in optima},
        "lines": [dataclasses.asdict(line) | {"row": line.row.name} for line in table],
        "cells": {
            cell.key: dataclasses.asdict(result)
            | {"gaps": {k: gap(cell.row, each) for k, each in result.policies.items()}}
            for cell, result in results.items()
        },
        "failures": found.failures,
        "provenance": provenance(),
    }
    write_text(folder / "results.json", json.dumps(jsonable(written), indent=1) + "\n")
    return found
