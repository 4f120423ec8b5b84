"""What thesis.py has solved is kept when it is interrupted, and the same command goes on."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scripts.studies.thesis import command as thesis
from scripts.studies.thesis.experiments import case_files, report, run
from scripts.studies.thesis.experiments.case import Case, Effort
from scripts.studies.thesis.experiments.cases import every_case, experiment_1, needed
from scripts.studies.thesis.experiments.solve import solved
from scripts.studies.thesis.experiments.solved import Solved
from scripts.studies.thesis.prototype import campaign

QUICK = Effort(2, elements=10)


def press(number: signal.Signals) -> None:
    os.kill(os.getpid(), number)


@pytest.fixture(scope="module")
def one() -> Solved:
    """A solved case."""
    return solved(experiment_1()[1])


@pytest.fixture(autouse=True)
def quick_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page of no content: the real one takes seconds, and has tests of its own."""

    def empty(path: Path) -> Path:
        path.write_text("")
        return path

    monkeypatch.setattr(report, "write_page", empty)


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the variants begun; each is solved from two starts only."""
    variants = list[str]()

    def noted(case: Case, before: Solved | None = None) -> Solved:
        variants.append(case.variant)
        return solved(dataclasses.replace(case, effort=QUICK), before)

    monkeypatch.setattr(run, "solved", noted)
    return variants


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_experiment_goes_on_with_what_is_missing(
    begun: list[str],
    by: signal.Signals,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ["--experiment", "1", "--workers", "1", "--out", str(tmp_path)]
    store = case_files.store

    def interrupted(folder: Path, solution: Solved) -> None:
        store(folder, solution)
        press(by)

    monkeypatch.setattr(case_files, "store", interrupted)
    assert thesis.main(command) == 130
    assert "the same command goes on" in capsys.readouterr().out
    assert begun == ["cost 4.3"]
    assert not (tmp_path / "results.json").exists()
    monkeypatch.setattr(case_files, "store", store)
    assert thesis.main(command) == 0
    assert begun == ["cost 4.3", "cost 4.4"]
    rows = json.loads((tmp_path / "results.json").read_text())
    assert [row["variant"] for row in rows] == ["cost 4.3", "cost 4.4"]
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["page.html", "report.html", "results.json"]


def test_a_case_in_a_file_is_the_case_that_was_solved(one: Solved, tmp_path: Path) -> None:
    case_files.store(tmp_path, one)
    again = case_files.recalled(tmp_path, needed([1]))
    assert list(again) == [one.key]
    assert again[one.key].rows() == one.rows()
    case_files.forget(tmp_path, needed([1]))
    assert not tmp_path.exists()


def test_a_file_that_is_damaged_or_of_another_version_is_not_used(
    one: Solved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case_files.store(tmp_path, one)
    path = case_files.place(tmp_path, one.key)
    content = path.read_bytes()
    path.write_bytes(content[:100])
    assert not case_files.recalled(tmp_path, needed([1]))
    path.write_bytes(content)
    other: dict[str, Any] = {"versions": {}, "git_revision": "another"}
    monkeypatch.setattr(case_files, "provenance", lambda: other)
    assert not case_files.recalled(tmp_path, needed([1]))


def test_every_case_has_a_file_of_its_own(tmp_path: Path) -> None:
    places = {case_files.place(tmp_path, case.key) for case in every_case()}
    assert len(places) == len(every_case())


def test_the_cases_that_a_wanted_case_continues_are_solved_too() -> None:
    keys = [case.key for case in needed([6])]
    assert keys[0] == (1, "cost 4.4")
    for case in needed([6]):
        assert case.after is None or case.after.key in keys[: keys.index(case.key)]


def test_an_interrupted_prototype_study_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(folder: Path, workers: int) -> Iterator[Any]:
        yield press(signal.SIGTERM)

    monkeypatch.setattr(campaign, "study", interrupted)
    assert thesis.main(["--prototype", "--out", str(tmp_path)]) == 130
    assert "goes on" in capsys.readouterr().out
