"""The cells of the study run one after the other, and go on where they were stopped."""

from __future__ import annotations

import dataclasses
import os
import signal
from pathlib import Path

import pytest

from scripts.studies.learning import running
from scripts.studies.learning.cells import Cell, Result, kept
from scripts.studies.learning.running import completed, ran
from tests.scripts.studies.learning.toys import cells_of, toy
from trajopt.processes import KilledError


def test_a_study_that_was_interrupted_goes_on_where_it_was(tmp_path: Path) -> None:
    class Stopping:
        def __init__(self) -> None:
            self.done = 0

        def __call__(self, cell: Cell, folder: Path) -> Result | str:
            self.done += 1
            return cell.run(folder) if self.done < 3 else stopped(cell).run(folder)

    def stopped(cell: Cell) -> Cell:
        trial = dataclasses.replace(cell.row.trial, stops_at=4)  # type: ignore[type-var]
        return dataclasses.replace(cell, row=dataclasses.replace(cell.row, trial=trial))

    cells = cells_of(toy(), 5)
    with pytest.raises(KeyboardInterrupt):
        completed(tmp_path, cells, 1, Stopping())
    assert [kept(tmp_path, cell) is not None for cell in cells] == [True, True] + 3 * [False]
    assert (tmp_path / "toy_2" / "counted").read_text() == "2222"
    again: list[str] = []

    def noting(cell: Cell, folder: Path) -> Result | str:
        again.append(cell.key)
        return ran(cell, folder)

    results, failures = completed(tmp_path, cells, 1, noting)
    assert (again, failures) == (["toy_2", "toy_3", "toy_4"], {})
    assert (tmp_path / "toy_2" / "counted").read_text() == 10 * "2"
    untouched, _ = completed(tmp_path / "untouched", cells, 1)
    assert list(results) == list(untouched) == cells
    assert [r.policies for r in results.values()] == [r.policies for r in untouched.values()]
    assert [result.steps for result in results.values()] == [1000, 2000, 3000, 4000, 5000]


def dies(cell: Cell, folder: Path) -> Result | str:
    if cell.seed == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return ran(cell, folder)


@pytest.mark.slow
def test_a_cell_whose_process_is_killed_is_named_and_the_others_are_kept(tmp_path: Path) -> None:
    cells = cells_of(toy(), 2)
    with pytest.raises(KilledError, match=r"^toy_1: its process was killed"):
        completed(tmp_path, cells, 2, dies)
    results, _ = completed(tmp_path, cells, 1)
    assert list(results) == cells


def test_cells_of_another_revision_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = cells_of(toy(), 1)
    completed(tmp_path, cells, 1)
    monkeypatch.setattr(running, "provenance", lambda: {"git_revision": "later"})
    completed(tmp_path, cells, 1)
    assert "toy_0: made by another revision than later" in capsys.readouterr().err
