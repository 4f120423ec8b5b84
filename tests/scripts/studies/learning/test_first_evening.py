"""The trial of a first evening with other people's learners."""

from __future__ import annotations

from pathlib import Path

from scripts.studies.learning.cells import Cell
from scripts.studies.learning.first_evening import POLICY, FirstEvening
from scripts.studies.learning.row import Row
from scripts.studies.learning.rows import FIRST_EVENING
from scripts.studies.learning.running import ran
from tests.scripts.studies.learning.toys import FEW


def test_a_first_evening_is_trained_once_and_judged_at_every_command(tmp_path: Path) -> None:
    trial = FirstEvening("SAC", n_envs=1, timesteps=1, commands=(0.35, 0.6))
    cell = Cell(Row("evening", "evening", FIRST_EVENING, trial), 0, protocol=FEW)
    first = cell.run(tmp_path)
    assert list(first.policies) == ["0.35 m/s", "0.6 m/s"]
    policy = tmp_path / "evening_0" / POLICY
    before = policy.stat().st_mtime_ns
    assert cell.run(tmp_path).policies == first.policies
    assert policy.stat().st_mtime_ns == before
    policy.write_bytes(policy.read_bytes()[:100])
    failure = ran(cell, tmp_path)
    assert isinstance(failure, str)
    assert f"{policy}: damaged" in failure
    assert "remove it to train anew" in failure
