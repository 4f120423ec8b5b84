"""The study over seeds, with trainings that take no time."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL, WheelParams
from scripts.studies.learning import optima
from scripts.studies.learning.cells import RESULT, Cell
from scripts.studies.learning.rows import FIRST_EVENING, LEARNED, THESIS
from scripts.studies.learning.running import completed
from scripts.studies.learning.study import Study, run
from tests.scripts.studies.learning.toys import cells_of, toy


def test_a_seed_that_fails_does_not_stop_the_others_and_is_tried_again(
    tmp_path: Path, no_gaits: None
) -> None:
    study = Study((toy("broken", fails=True), toy("sound")), 2, BUILDABLE)
    found = run(study, ["broken", "sound"], tmp_path, 1)
    assert found.failures == dict.fromkeys(
        ("broken_0", "broken_1"), "ValueError: this learner cannot learn"
    )
    assert found.unfinished == ("broken (0 of 2 seeds)",)
    assert "a sound" in found.sections[LEARNED]
    assert "a broken" not in found.sections[LEARNED]
    assert not (tmp_path / "broken_0" / RESULT).exists()


def test_rows_that_were_finished_before_stay_in_the_tables(tmp_path: Path, no_gaits: None) -> None:
    second = toy("second", FIRST_EVENING, standing=(0,), period=0.04)
    study = Study((toy("first"), second), 2, BUILDABLE)
    first = run(study, ["first"], tmp_path, 1)
    assert first.unfinished == ("second (0 of 2 seeds)",)
    assert list(first.sections) == [LEARNED]
    both = run(study, ["second"], tmp_path, 1)
    assert both.unfinished == ()
    assert both.sections[LEARNED] == first.sections[LEARNED]
    evening = both.sections[FIRST_EVENING]
    assert "| a second | best | 1 of 2 | 50 % (0 to 100) |" in evening
    assert "| a second | last | 2 of 2 |" in evening
    assert "| a second | all of these | 1 of 2 |" in evening
    written = json.loads((tmp_path / "results.json").read_text())
    assert written["cells"]["second_0"]["policies"]["best"]["share"] == 0.0


def test_a_row_may_have_a_machine_of_its_own_and_its_optimum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = set()

    def best_held(params: WheelParams, ticks: int, folder: Path) -> Any:
        asked.add(params)
        cot = {BUILDABLE: 0.05, THESIS_PHYSICAL: 0.01}[params]
        return SimpleNamespace(speed=params.step_length / (0.01 * ticks), cot=cot)

    monkeypatch.setattr(optima, "best_held", best_held)
    other = dataclasses.replace(toy("other", THESIS), machine="THESIS_PHYSICAL")
    study = Study((toy("usual"), other), 1, BUILDABLE)
    assert [cell.params for cell in study.cells()] == [BUILDABLE, THESIS_PHYSICAL]
    found = run(study, ["usual", "other"], tmp_path, 1)
    assert asked == {BUILDABLE, THESIS_PHYSICAL}
    assert "| +20.0 % (" in found.sections[LEARNED]
    best = found.sections[THESIS].splitlines()[2]
    assert "| +500.0 % (" in best
    assert best.endswith("| 0.0500 |")  # above the optimum


def test_a_row_tells_of_its_first_seeds_if_they_are_at_least_three(
    tmp_path: Path, no_gaits: None
) -> None:
    long, short = toy("long"), toy("short")
    five = Study((long, short), 5, BUILDABLE)
    completed(tmp_path, [*Study((long,), 4, BUILDABLE).cells(), *cells_of(short, 2)], 1)
    completed(tmp_path, [Cell(short, 4)], 1)
    found = run(five, [], tmp_path, 1)
    assert "| a long, best | 4 of 4 |" in found.sections[LEARNED]
    assert "short" not in found.sections[LEARNED]
    assert found.unfinished == ("long (4 of 5 seeds)", "short (0 of 5 seeds)")


def test_a_gap_needs_an_optimum_that_holds_actions_as_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def best_held(params: WheelParams, ticks: int, folder: Path) -> Any:
        return SimpleNamespace(speed=params.step_length / (0.01 * ticks), cot=0.05)

    monkeypatch.setattr(optima, "best_held", best_held)
    study = Study((toy("usual"), toy("longer", period=0.04)), 3, BUILDABLE)
    run(study, ["usual", "longer"], tmp_path, 1)
    lines = json.loads((tmp_path / "results.json").read_text())["lines"]
    gaps = {line["row"]: line["gap"] for line in lines if line["which"] == "last"}
    assert gaps["usual"]["mean"] == pytest.approx(0.22)
    assert gaps["longer"] is None
