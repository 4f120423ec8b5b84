"""The study of feedback laws: what it measures, that it continues, and what it writes."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rimless_gym import BUILDABLE, RimlessWheelVectorEnv
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from scripts.studies.documents import markdown
from scripts.studies.feedback_laws import command, measures
from scripts.studies.feedback_laws.measures import (
    GAITS,
    MEASURES,
    Measurement,
    Sizes,
    changed_machines,
    drawn_states,
    pushed_states,
    subject_of,
)
from trajopt.feedback import startup

DOCS = Path(__file__).parents[3] / "docs"
GAIT = "BUILDABLE at 0.62 m/s"


@pytest.fixture(scope="module")
def small() -> Iterator[None]:
    """A coarse start-up controller, and as few walks as possible."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(startup, "COUNTS", (5, 16, 11, 13))
        patch.setattr(measures, "FOR_A_TRIAL", Sizes(2, 2, 2, 1, 2, 1, 4, shorter=20.0))
        yield


@pytest.fixture(scope="module")
def folder(small: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished trial."""
    folder = tmp_path_factory.mktemp("feedback")
    command.study(folder, [GAIT], ["lqr"], 1, True)
    return folder


@pytest.mark.slow
def test_a_killed_study_continues_and_gives_the_same_table(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    stored = sorted(tmp_path.glob("*_lqr_*.json"))
    assert len(stored) == len(MEASURES)
    stored[0].unlink()
    stored[1].write_text(stored[1].read_text()[:20])
    again = list[str]()

    def measured(task: Measurement) -> dict[str, Any]:
        again.append(task.measure)
        return measures.measured(task)

    monkeypatch.setattr(command, "measured", measured)
    results, errors = command.study(tmp_path, [GAIT], ["lqr"], 1, True)
    assert errors == {}
    assert len(again) == 2
    assert command.tables(results).count("`lqr`") == 1
    assert set(results[GAIT]["lqr"]) == set(MEASURES)


@pytest.mark.slow
def test_a_law_that_fails_is_named_and_does_not_stop_the_others(folder: Path) -> None:
    results, errors = command.study(folder, [GAIT], ["lqr", "no_such_law"], 1, True)
    assert set(results[GAIT]["lqr"]) == set(MEASURES)
    assert len(errors) == len(MEASURES)
    assert all("'no_such_law': choose from" in error for error in errors.values())
    assert "| `no_such_law` | - |" in command.tables(results)


@pytest.mark.slow
def test_the_page_has_a_place_for_the_tables(folder: Path, tmp_path: Path) -> None:
    results, _ = command.study(folder, [GAIT], ["lqr"], 1, True)
    path = tmp_path / "feedback.md"
    shutil.copy(DOCS / "feedback.md", path)
    sections = {"gaits": command.tables(results) + "\n"}
    markdown.refresh(path, command.MARKS, sections)
    text = path.read_text()
    assert f"### {GAIT}" in text
    markdown.refresh(path, command.MARKS, sections)
    assert path.read_text() == text


def test_the_tables_of_the_page_are_those_that_the_study_writes() -> None:
    text = (DOCS / "feedback.md").read_text()
    head = command.tables({}.fromkeys(GAITS, {})).splitlines()
    assert all(line in text.splitlines() for line in head)


@pytest.mark.slow
def test_random_states_press_on_the_ground_and_are_the_same_for_all_laws(folder: Path) -> None:
    subject = subject_of(GAIT, "lqr", folder, True)
    states = drawn_states(subject, 10)
    assert np.array_equal(states, drawn_states(subject, 12)[:10])
    assert states[:, 2].min() < 0 < states[:, 2].max()


def test_a_push_is_that_of_the_environment() -> None:
    c, impulse = BUILDABLE.constants, 0.3
    x = np.zeros((1, STATE_SIZE))
    x[0, :4] = [0.5 * (c.a + c.b), 0.4, 1.0, -2.0]
    envs = RimlessWheelVectorEnv(
        1, BUILDABLE, disturbances={"pushes": {"rate": 1e9, "impulse": (impulse, impulse)}}
    )
    envs.reset(seed=0, options={"state": x[:, :4], "mode": "single_stance"})
    envs.step(np.zeros((1, 1), np.float32))
    ends = []
    for sign in (1.0, -1.0):
        pushed = pushed_states(BUILDABLE, x, np.array([sign * impulse]))
        advance(BUILDABLE, pushed, np.zeros(1))
        ends.append(np.allclose(pushed[:, :4], envs.states[:, :4], rtol=1e-12))
    assert sum(ends) == 1


def test_every_parameter_of_the_machine_is_changed_up_and_down_by_itself() -> None:
    changed = list(changed_machines(BUILDABLE))
    assert {name for name, _, _ in changed} > {"pendulum_length", "motor_constant", "gear_loss"}
    for name, change, params in changed:
        assert getattr(params, name) == pytest.approx((1 + change) * getattr(BUILDABLE, name))
        others = {k for k, v in params.to_dict().items() if v != BUILDABLE.to_dict()[k]}
        assert others <= {name, "pendulum_reach"}
