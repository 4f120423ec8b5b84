"""Shipped policies compete on their own machine, one of them at the study's speeds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from agents.comparison import shipped as shipped_policy
from agents.comparison import speed_figure
from agents.comparison.arena import Arena
from agents.comparison.charts import speed_charts
from agents.comparison.labels import Named
from agents.comparison.shipped import FILE, SCREENED, TITLE, for_the_front, from_screened
from agents.comparison.study import Study
from agents.policy_files import load_policy
from rimless_gym import BUILDABLE
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.library import shipped

FOUND = {
    "cot": 0.05,
    "objective": 0.2,
    "speed": 0.56,
    "friction_demand": 0.6,
    "impulse_friction_demand": 0.7,
    "min_normal_force_over_weight": 0.2,
    "walking_share": 1.0,
}


@pytest.fixture
def front() -> CotFront:
    own = [gait for gait in shipped() if gait.params == BUILDABLE and gait.steps == 1]
    return CotFront(tuple(gait for gait in own if 0.5 <= gait.speed <= 0.6))


def test_it_walks_at_every_speed_of_the_study_and_at_two_between() -> None:
    study = Study()
    (entrant,) = for_the_front(study)
    assert {study.on_tick(speed) for speed in study.speeds} < set(entrant.commands)
    assert len(entrant.commands) == len(study.speeds) + 2


def test_a_file_of_its_name_in_the_current_folder_does_not_take_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "front.zip").write_text("another policy")
    monkeypatch.chdir(tmp_path)
    assert for_the_front(Study())


def test_it_leaves_out_speeds_that_it_was_not_trained_for() -> None:
    (entrant,) = for_the_front(Study(speed=0.4, further=(0.56,)))
    speeds = load_policy(FILE).conditions.control.speeds
    assert speeds is not None
    assert all(speeds[0] <= command <= speeds[1] for command in entrant.commands)


@pytest.mark.parametrize("changes", [{"friction": 0.7}, {"gear_loss": 0.0}])
def test_it_stays_away_from_other_machines(changes: dict[str, Any]) -> None:
    assert for_the_front(Study(changes=changes)) == ()


def test_another_file_or_other_commands_are_another_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (entrant,), (other,) = for_the_front(Study()), for_the_front(Study(further=()))
    before = entrant.name
    assert other.name != before
    changed = tmp_path / "front.zip"
    changed.write_bytes(FILE.read_bytes() + b"more")
    monkeypatch.setattr(shipped_policy, "FILE", changed)
    assert entrant.name != before


def test_ppo_from_screened_policies_competes_on_its_own_machine_only(
    tmp_path: Path, front: CotFront, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert from_screened(Study(changes={"friction": 0.7})) == ()
    (entrant,) = from_screened(Study())
    arena = Arena(Study(), tmp_path, progress=False)
    arena.held_front = front
    monkeypatch.setattr(arena, "evaluated", lambda policy: {"evaluation": FOUND})
    (row,) = entrant.rows(arena, entrant.compete(arena))
    assert (row["policy"], row["at"], row["cot"]) == (SCREENED, None, FOUND["cot"])
    assert row["gap"] == pytest.approx(arena.gap(FOUND["cot"], FOUND["speed"]))
    before, changed = entrant.name, tmp_path / "screened_ppo.zip"
    changed.write_bytes(shipped_policy.SCREENED_FILE.read_bytes() + b"more")
    monkeypatch.setattr(shipped_policy, "SCREENED_FILE", changed)
    assert entrant.name != before


def test_the_rows_of_the_policy_for_the_front_stand_beside_the_others_of_the_same_speed(
    tmp_path: Path, front: CotFront
) -> None:
    study = Study()
    arena = Arena(study, tmp_path, progress=False)
    arena.held_front = front
    (entrant,) = for_the_front(study)
    rows = entrant.rows(arena, {"commanded": [FOUND] * len(entrant.commands)})
    assert {row["policy"] for row in rows} == {TITLE}
    assert set(study.speeds) < {row["at"] for row in rows}


def walks() -> list[dict[str, Any]]:
    """Rows of it, at three speeds."""
    row = {"policy": TITLE, "cot": 0.05, "gap": 0.01, "walking_share": 1.0}
    return [row | {"speed": speed} for speed in (0.52, 0.55, 0.58)]


def test_a_printed_plot_names_only_its_last_point(
    front: CotFront, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named: list[Named] = []
    monkeypatch.setattr(speed_figure, "write_names", lambda axes, names: named.extend(names))
    speed_figure.plot_cot_against_speed(tmp_path / "plot.png", front, front, walks())
    assert [each.x for each in named if each.name == TITLE] == [0.58]


def test_a_plot_joins_its_points(front: CotFront) -> None:
    for chart in speed_charts(front, front, walks()):
        (joined,) = [series for series in chart.series if series.name == TITLE]
        assert list(joined.x) == [0.52, 0.55, 0.58]
        assert joined.line == "solid"
