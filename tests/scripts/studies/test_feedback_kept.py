"""The study of feedback laws: what it keeps, and what is measured or solved again."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from rimless_gym.params import WheelParams
from scripts.studies.feedback_laws import command, drawing, gaits, page
from scripts.studies.feedback_laws.cells import Cell, measured
from scripts.studies.feedback_laws.columns import COLUMNS
from scripts.studies.feedback_laws.columns.attraction import random_states
from scripts.studies.feedback_laws.gaits import GAITS, Held
from scripts.studies.feedback_laws.study import study
from scripts.studies.feedback_laws.subject import subject_of
from trajopt.gaits.solution import Solution

HELD = GAITS[2]
DOCS = Path(__file__).parents[3] / "docs"


class Repeating:
    """Measures by reading a finished trial; it counts the cells, and may be interrupted."""

    def __init__(self, trial: dict[str, Any], interrupted_at: int | None = None) -> None:
        self.trial, self.interrupted_at, self.done = trial, interrupted_at, list[str]()

    def __call__(self, cell: Cell, gait: Path) -> dict[str, Any]:
        if len(self.done) == self.interrupted_at:
            raise KeyboardInterrupt
        self.done.append(cell.column)
        return {"found": self.trial["results"][cell.gait]["lqr"][cell.column], "seconds": 1.0}


def with_gait(kept: Path, folder: Path) -> Path:
    shutil.copytree(kept / "gaits", folder / "gaits")
    return folder


@pytest.mark.slow
def test_a_study_that_was_interrupted_goes_on_and_gives_the_same_table(
    kept: Path, trial: dict[str, Any], tmp_path: Path
) -> None:
    folder, first = with_gait(kept, tmp_path), Repeating(trial, interrupted_at=3)
    with pytest.raises(KeyboardInterrupt):
        study(folder, [HELD], ["lqr"], 1, True, first)
    second, third = Repeating(trial), Repeating(trial)
    found = study(folder, [HELD], ["lqr"], 1, True, second)
    assert first.done + second.done == list(COLUMNS)
    assert study(folder, [HELD], ["lqr"], 1, True, third)["results"] == found["results"]
    assert third.done == []
    assert page.sections(found)["gaits"] == page.sections(trial)["gaits"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:20],
        lambda text: "[]",
        lambda text: "[" * 100_000,
        lambda text: json.dumps(json.loads(text) | {"found": {}}),
        lambda text: json.dumps(json.loads(text) | {"found": {"gap": 0.001}}),
        lambda text: json.dumps(json.loads(text) | {"seconds": "2"}),
    ],
    ids=["cut", "list", "deep", "empty", "edited", "of another type"],
)
@pytest.mark.slow
def test_a_damaged_or_edited_cell_is_named_and_measured_again(
    damage: Callable[[str], str],
    kept: Path,
    trial: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = with_gait(kept, tmp_path)
    study(folder, [HELD], ["lqr"], 1, True, Repeating(trial))
    path = folder / "cells" / f"{HELD.key}_lqr_cost.json"
    path.write_text(damage(path.read_text()))
    again = Repeating(trial)
    study(folder, [HELD], ["lqr"], 1, True, again)
    assert again.done == ["cost"]
    (line,) = [each for each in capsys.readouterr().err.splitlines() if "measured again" in each]
    assert f"{path}: damaged" in line


@pytest.mark.parametrize(
    ("params", "speed", "again"),
    [(BUILDABLE, 0.605, False), (BUILDABLE, 0.59, True), (THESIS_PHYSICAL, 0.605, True)],
)
@pytest.mark.slow
def test_a_kept_gait_of_another_machine_or_speed_is_not_the_one_that_is_asked_for(
    kept: Path, monkeypatch: pytest.MonkeyPatch, params: WheelParams, speed: float, again: bool
) -> None:
    path = kept / "gaits" / f"{HELD.key}.npz"
    monkeypatch.setattr(gaits, "preset", lambda name: params)
    assert (Held("BUILDABLE", speed).fault_of(path) is not None) is again


@pytest.mark.slow
def test_a_gait_is_solved_only_if_none_is_kept(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gait = Solution.load(kept / "gaits" / f"{HELD.key}.npz")
    monkeypatch.setattr(Held, "solved", lambda held: gait)
    assert gaits.kept(tmp_path, [HELD])[HELD.key].exists()
    monkeypatch.delattr(Held, "solved")
    gaits.kept(tmp_path, [HELD])


@pytest.mark.parametrize("fault", ["damaged", "failed its verification"])
@pytest.mark.slow
def test_a_kept_gait_that_is_of_no_use_is_named_and_solved_again(
    fault: str,
    kept: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    gait, path = Solution.load(kept / "gaits" / f"{HELD.key}.npz"), tmp_path / f"{HELD.key}.npz"
    path.touch()
    if fault != "damaged":
        failures = dataclasses.replace(gait.verification, failures=("slips",))
        dataclasses.replace(gait, verification=failures).save(path)
    monkeypatch.setattr(Held, "solved", lambda held: gait)
    gaits.kept(tmp_path, [HELD])
    assert HELD.fault_of(path) is None
    (line,) = [each for each in capsys.readouterr().err.splitlines() if "solved again" in each]
    assert str(path) in line
    assert fault in line


def test_a_folder_in_the_place_of_a_gait_is_one_line_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "quick" / "gaits" / f"{HELD.key}.npz"
    path.mkdir(parents=True)
    with pytest.raises(SystemExit):
        command.main(["--quick", "--gaits", HELD.key, "--out", str(tmp_path)])
    assert f"error: {path}: a folder in the place of a gait's file" in capsys.readouterr().err


@pytest.mark.slow
def test_a_law_that_fails_is_named_and_does_not_stop_the_others(
    kept: Path, trial: dict[str, Any], tmp_path: Path
) -> None:
    folder = with_gait(kept, tmp_path)
    gait = folder / "gaits" / f"{HELD.key}.npz"
    failure = measured(Cell(HELD.key, "no_such_law", "cost", False, True), gait)
    assert "no_such_law" in failure["error"]

    def failing(cell: Cell, gait: Path) -> dict[str, Any]:
        return failure if cell.column == "cost" else Repeating(trial)(cell, gait)

    found = study(folder, [HELD], ["lqr"], 1, True, failing)
    assert list(found["errors"]) == [f"{HELD.key}_lqr_cost"]
    assert not (folder / "cells" / f"{HELD.key}_lqr_cost.json").exists()
    assert page.sections(found)
    assert drawing.figures(found)


@pytest.mark.slow
def test_the_page_has_a_place_for_every_section_and_is_filled_the_same_way_twice(
    trial: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "feedback.md"
    shutil.copy(DOCS / "feedback.md", path)
    page.refresh(path, trial)
    once = path.read_text()
    page.refresh(path, trial)
    assert path.read_text() == once
    assert f"### {HELD.preset} at {HELD.speed:g} m/s" in once
    assert "| `lqr` |" in once


@pytest.mark.slow
def test_random_states_press_on_the_ground_and_are_the_same_for_all_laws(kept: Path) -> None:
    subject = subject_of(kept / "gaits" / f"{HELD.key}.npz", "lqr")
    orbit = subject.law.data.orbit
    states = random_states(subject, orbit, 10)
    assert np.array_equal(states, random_states(subject, orbit, 12)[:10])
    assert states[:, 2].min() < 0 < states[:, 2].max()
