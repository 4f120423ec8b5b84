"""The comparison study: what it keeps, what it refuses, what it prints."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agents.compare import Comparison
from agents.report import format_table, gap_to_front
from agents.study import Study
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.shipped import shipped


def test_a_finished_stage_is_not_run_again(tmp_path: Path) -> None:
    comparison, calls = Comparison(Study(), tmp_path, progress=False), []

    def work() -> dict[str, int]:
        calls.append(1)
        return {"figure": 7}

    first = comparison._stage("stage", work)
    again = Comparison(Study(), tmp_path, progress=False)._stage("stage", work)
    assert first == again
    assert first["figure"] == 7
    assert first["wall_time_s"] >= 0
    assert len(calls) == 1


def test_an_interrupted_stage_leaves_no_result_and_keeps_those_before(tmp_path: Path) -> None:
    comparison = Comparison(Study(), tmp_path, progress=False)
    comparison._stage("finished", dict)

    def interrupted() -> dict[str, int]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        comparison._stage("unfinished", interrupted)
    assert (tmp_path / "finished.json").exists()
    assert not (tmp_path / "unfinished.json").exists()
    assert comparison._stage("unfinished", lambda: {"figure": 7})["figure"] == 7


def test_a_stage_whose_files_are_missing_is_run_again(tmp_path: Path) -> None:
    comparison, calls = Comparison(Study(), tmp_path, progress=False), []

    def work() -> dict[str, list[str]]:
        calls.append(1)
        (tmp_path / "gait.npz").write_bytes(b"a gait")
        return {"files": ["gait.npz"]}

    for _ in range(2):
        comparison._stage("stage", work)
    assert len(calls) == 1
    (tmp_path / "gait.npz").unlink()
    comparison._stage("stage", work)
    assert len(calls) == 2


@pytest.mark.parametrize("text", ["", "{", "null", "[1]", "{}", "\xff"])
def test_a_damaged_stage_is_named_with_the_remedy(tmp_path: Path, text: str) -> None:
    comparison = Comparison(Study(), tmp_path, progress=False)
    (tmp_path / "stage.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=r"stage\.json: damaged.*remove it"):
        comparison._stage("stage", dict)


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(ValueError, match="is a file: choose a folder"):
        Comparison(Study(), tmp_path / "file", progress=False)
    assert (tmp_path / "file").read_text() == "precious"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"speed": math.nan}, "speed = nan"),
        ({"front": (0.5, -1.0)}, "speed = -1.0"),
        ({"timesteps": -1}, "timesteps = -1"),
        ({"seed": -1}, "seed = -1"),
        ({"steps": 0}, "steps = 0"),
    ],
)
def test_bad_settings_are_refused_before_a_folder_is_claimed(settings, message) -> None:
    with pytest.raises(ValueError, match=message):
        Study(**settings)


def test_a_damaged_file_is_named_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(ValueError, match=r"study\.json: damaged.*remove it"):
        Comparison(Study(), tmp_path, progress=False)


def test_a_folder_with_another_study_is_refused(tmp_path: Path) -> None:
    Comparison(Study(seed=1), tmp_path, progress=False)
    with pytest.raises(ValueError, match=r"seed.*1 \(not 0\).*--out"):
        Comparison(Study(seed=0), tmp_path, progress=False)


def test_an_unknown_preset_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unknown preset 'THESIS'"):
        Comparison(Study(preset="THESIS"), tmp_path, progress=False)


def test_a_policy_that_does_not_walk_has_dashes_in_the_table() -> None:
    row = {"policy": "scratch", "cot": None, "speed": math.nan, "gap": None}
    table = format_table([row | {"walking_share": 0.0}])
    assert table.splitlines()[2] == "| scratch | - | - | - | 0% |"


def test_the_gap_is_taken_at_the_learned_speed_and_nowhere_off_the_front() -> None:
    gaits = [gait for gait in shipped() if gait.steps == 1]
    slow, fast = min(gaits, key=lambda g: g.speed), max(gaits, key=lambda g: g.speed)
    front = CotFront((slow, fast))
    middle = (slow.speed + fast.speed) / 2
    optimal = (slow.cot + fast.cot) / 2
    assert gap_to_front(1.25 * optimal, middle, front) == pytest.approx(0.25)
    assert gap_to_front(slow.cot, slow.speed, front) == pytest.approx(0.0)
    assert gap_to_front(1.0, fast.speed + 0.01, front) is None
    assert gap_to_front(None, None, front) is None
