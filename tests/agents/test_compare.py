"""The comparison study: what it keeps, what it refuses, what it prints."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agents.comparison.arena import Arena
from agents.comparison.compare import Comparison
from agents.comparison.entrants import entrants
from agents.comparison.report import by_speed, format_table, gait_row, policy_row
from agents.comparison.stages import read_stage, write_stage
from agents.comparison.study import Study
from rimless_gym import BUILDABLE, Task
from trajopt.feedback import laws, startup
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.library import shipped

STUDY = {"seed": 0}


def test_a_stage_is_read_as_it_was_written(tmp_path: Path) -> None:
    assert read_stage(tmp_path, "lqr", STUDY) == (None, [])
    (tmp_path / "gait.npz").write_bytes(b"a gait")
    result = {"cot": 0.03, "unknown": None, "files": ["gait.npz"]}
    write_stage(tmp_path, "lqr", STUDY, result)
    assert read_stage(tmp_path, "lqr", STUDY) == (result, [])


@pytest.mark.parametrize("content", [None, b"", b"another gait"])
def test_files_of_a_stage_that_are_missing_or_changed_are_named(
    tmp_path: Path, content: bytes | None
) -> None:
    (tmp_path / "gait.npz").write_bytes(b"a gait")
    write_stage(tmp_path, "gait", STUDY, {"files": ["gait.npz"]})
    (tmp_path / "gait.npz").unlink()
    if content is not None:
        (tmp_path / "gait.npz").write_bytes(content)
    assert read_stage(tmp_path, "gait", STUDY)[1] == ["gait.npz"]


@pytest.mark.parametrize(
    "text", ["", "{", "null", "[1]", "{}", "\xff", '{"digest": 3}', "[" * 9999]
)
def test_a_damaged_stage_is_named_with_the_remedy(tmp_path: Path, text: str) -> None:
    (tmp_path / "lqr.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=r"lqr\.json: damaged.*remove it"):
        read_stage(tmp_path, "lqr", STUDY)


def test_a_stage_that_was_edited_or_is_of_another_study_is_refused(tmp_path: Path) -> None:
    write_stage(tmp_path, "lqr", STUDY, {"cot": 0.03})
    with pytest.raises(ValueError, match=r"of another study.*remove it"):
        read_stage(tmp_path, "lqr", {"seed": 1})
    path = tmp_path / "lqr.json"
    path.write_text(path.read_text().replace("0.03", "0.01"))
    with pytest.raises(ValueError, match=r"edited since.*remove it"):
        read_stage(tmp_path, "lqr", STUDY)


@pytest.mark.parametrize("text", ["{", "[]", '{"study": 3}', "{}"])
def test_a_damaged_study_is_named_with_the_remedy(tmp_path: Path, text: str) -> None:
    (tmp_path / "study.json").write_text(text)
    with pytest.raises(ValueError, match=r"study\.json: damaged.*remove it"):
        Comparison(Study(), tmp_path, progress=False)


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


def test_a_folder_with_another_study_is_refused(tmp_path: Path) -> None:
    Comparison(Study(seed=1), tmp_path, progress=False)
    with pytest.raises(ValueError, match=r"seed.*1 \(not 0\).*--out"):
        Comparison(Study(seed=0), tmp_path, progress=False)


def test_an_unknown_preset_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unknown preset 'THESIS'"):
        Comparison(Study(preset="THESIS"), tmp_path, progress=False)


@pytest.mark.slow
def test_every_feedback_law_enters_by_its_file(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "at_rest.py").write_text(
        "from rimless_gym.jit import inner\n"
        "from trajopt.feedback.law import Law\n"
        "from trajopt.feedback.laws import lqr\n\n\n"
        "@inner\n"
        "def nothing(x, mode, data):\n"
        "    return 0.0\n\n\n"
        "def design(solution):\n"
        "    return Law(solution.params, nothing, lqr.design(solution).data)\n"
    )
    monkeypatch.setattr(startup, "startup_for", lambda *args: lambda x, mode: 0 * x[:, 0])
    before = [entrant.name for entrant in entrants(Study())]
    monkeypatch.setattr(laws, "__path__", [*laws.__path__, str(tmp_path)])
    now = {entrant.name: entrant for entrant in entrants(Study())}
    assert set(now) - set(before) == {"at_rest"}
    arena = Arena(Study(), tmp_path, progress=False)
    arena.held_front = CotFront(tuple(shipped()[:2]))
    with pytest.warns(UserWarning, match=r"nothing, .* does not hold its gait by itself"):
        result = now["at_rest"].compete(arena)
    [row] = now["at_rest"].rows(arena, result)
    assert (row["policy"], row["walking_share"]) == ("at rest about the optimum", 0.0)


def test_a_gap_that_rounds_to_nothing_has_no_minus_sign() -> None:
    row = {"policy": "optimal", "cot": 0.03, "return": 0.2, "speed": 0.5, "gap": -3e-5}
    row |= {"walking_share": None, "friction_demand": 0.9, "min_normal_force_over_weight": 0.3}
    assert "| +0.0% |" in format_table([row])


def test_a_policy_that_does_not_walk_has_dashes_in_the_table() -> None:
    row = {"policy": "scratch", "cot": None, "return": -0.4, "speed": math.nan, "gap": None}
    row |= {"friction_demand": None, "min_normal_force_over_weight": None}
    table = format_table([row | {"walking_share": 0.0}])
    assert table.splitlines()[2] == "| scratch | - | -0.400 | - | - | 0% | - | - |"


def test_the_table_shows_what_gaits_and_policies_ask_of_the_ground() -> None:
    gait = shipped()[0]
    v = gait.verification
    demand = max(v.max_friction_demand, v.max_impulse_friction_demand)
    row = gait_row("optimal", gait, 0.0, 0.5)
    line = format_table([row]).splitlines()[2]
    assert line.endswith(f"| - | {demand:.2f} | {v.min_normal_force_over_weight:.2f} |")
    slipping = {
        "cot": None,
        "objective": 0.1,
        "speed": None,
        "friction_demand": 0.9,
        "impulse_friction_demand": 1.2,
        "min_normal_force_over_weight": 0.06,
        "walking_share": 0.0,
    }
    row = policy_row("slipping", slipping, None, None)
    line = format_table([row]).splitlines()[2]
    assert line == "| slipping | - | 0.100 | - | - | 0% | 1.20 | 0.06 |"


def test_the_return_of_a_gait_is_the_reward_of_walking_on_it() -> None:
    gait = next(gait for gait in shipped() if gait.params == BUILDABLE and gait.steps == 1)
    row = gait_row("optimal", gait, None, None)
    v, energy = gait.verification, gait.verification.electrical_positive
    reward = Task().distance_weight * v.distance - energy / gait.params.weight
    assert row["return"] == pytest.approx(reward / v.time, rel=1e-6)


def test_rows_stand_in_order_of_their_speeds_and_those_of_no_speed_at_the_end() -> None:
    listed = [{"policy": str(at), "at": at} for at in (None, 0.6, 0.5, 0.6)]
    assert [row["at"] for row in by_speed(listed)] == [0.5, 0.6, 0.6, None]
