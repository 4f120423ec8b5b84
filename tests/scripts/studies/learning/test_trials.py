"""The trials of the study: what is trained, and how it is judged."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from agents import learners
from agents.folder import BEST, CLONE, LAST
from agents.imitation import Cloning
from agents.policy_files import PRETRAINED, read_record
from agents.protocol import PROTOCOL
from agents.train import EXPERT, TrainResult, train
from agents.training import IMITATION, SCRATCH
from rimless_gym import BUILDABLE
from scripts.studies.learning import trials
from scripts.studies.learning.cells import Cell
from scripts.studies.learning.row import Row
from scripts.studies.learning.rows import DISTURBED, FRONT, LEARNED
from scripts.studies.learning.trials import PLANS, Disturbed, Following, Holding, Trained
from tests.scripts.studies.learning.toys import FEW


def test_a_training_by_agents_train_is_judged_from_its_own_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trained(algo: str, init: str, seed: int, out: Path, **others: Any) -> TrainResult:
        for shipped, file in (("imitation", CLONE), ("evolution", BEST)):
            shutil.copy(PRETRAINED[shipped], out / file)
        stopped = others["timesteps"] == 1
        return TrainResult(out / BEST, out / LAST, out / CLONE, 4096, stopped, (), ())

    monkeypatch.setattr(trials, "train", trained)
    few = dataclasses.replace(PROTOCOL, starts=2, duration=12.0, window=4.0, alive=2.0)
    trial = Trained("ppo", IMITATION, 4096, (("clone", CLONE), ("best kept", BEST)))
    cell = Cell(Row("learner", "learner", LEARNED, trial), 0, protocol=few)
    result = cell.run(tmp_path)
    clone, best = result.policies["clone"], result.policies["best kept"]
    assert (clone.share, best.share, result.steps) == (1.0, 1.0, 4096)
    assert clone.speed is not None
    assert best.speed is not None
    assert clone.speed < best.speed  # those of two gaits
    row = dataclasses.replace(cell.row, trial=dataclasses.replace(trial, timesteps=1))
    with pytest.raises(KeyboardInterrupt):
        dataclasses.replace(cell, row=row).run(tmp_path)


def test_a_law_about_another_speed_holds_the_gait_nearest_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def front(params: Any, speeds: list[float], steps: list[int], hold: float, folder: Path) -> Any:
        return SimpleNamespace(envelope=((speeds, steps, hold, folder),))

    monkeypatch.setattr(trials, "cot_front", front)
    monkeypatch.setattr(trials.laws, "design", lambda *given: given)
    trial = Holding("ppo", IMITATION, 0, speed=0.48)
    law, gait, kept = trial.expert(0, tmp_path / "slow_0", BUILDABLE)  # type: ignore[misc]
    assert (law, kept) == ("lqr", tmp_path / "plans")
    assert gait == ([0.48], [1], 0.01, tmp_path / "plans")
    assert trial.settings != dataclasses.replace(trial, speed=0.5).settings


@pytest.mark.slow
def test_a_policy_that_follows_is_judged_at_every_command_and_every_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def trained(*given: Any, **arguments: Any) -> TrainResult:
        asked.append(arguments)
        return train(*given, **arguments | {"settings": small})

    full = learners.learner("ppo").settings(SCRATCH)
    small = dataclasses.replace(
        full, n_envs=2, algorithm=full.algorithm | {"n_steps": 64, "batch_size": 64}
    )
    monkeypatch.setattr(trials, "train", trained)
    trial = Following(
        "ppo",
        SCRATCH,
        128,
        (("", LAST),),
        speeds=(0.4, 0.6),
        control_period=0.02,
        commands=(0.45, 0.55),
        changes=(0.5, 0.4, 0.6),
    )
    found = Cell(Row("front", "front", FRONT, trial), 0, protocol=FEW).run(tmp_path)
    assert (asked[0]["speeds"], asked[0]["control_period"]) == ((0.4, 0.6), 0.02)
    assert list(found.policies) == [
        *("0.45 m/s", "0.55 m/s"),
        *("0.4 m/s after 0.5", "0.6 m/s after 0.4"),
    ]
    assert found.policies["0.45 m/s"].share == 0.0


def test_a_clone_that_follows_is_made_between_its_speeds_with_its_own_labels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def trained(*given: Any, **arguments: Any) -> TrainResult:
        asked.append((given, arguments))
        return TrainResult(tmp_path, tmp_path, tmp_path, 0, False, (), ())

    monkeypatch.setattr(trials, "train", trained)
    trial = Following("ppo", IMITATION, 0, speeds=(0.4, 0.6), cloning={"rounds": 3})
    trial.train(7, tmp_path / "front_7", BUILDABLE)
    [(given, arguments)] = asked
    assert given[1] == IMITATION
    assert (arguments["speeds"], arguments["expert"]) == ((0.4, 0.6), EXPERT)
    assert arguments["cloning"] == dataclasses.replace(Cloning(), rounds=3)
    assert arguments["plans"] == tmp_path / PLANS
    from_scratch = dataclasses.replace(trial, init=SCRATCH)
    assert from_scratch.cloned is None
    assert trial.settings != dataclasses.replace(trial, cloning={}).settings
    with pytest.raises((TypeError, ValueError), match="runds"):
        dataclasses.replace(trial, cloning={"runds": 3}).train(7, tmp_path / "x_7", BUILDABLE)


@pytest.mark.slow
def test_a_policy_trained_under_disturbances_is_judged_with_each_of_them_and_without(
    tmp_path: Path,
) -> None:
    trial = Disturbed(
        "ppo",
        SCRATCH,
        64,
        (("last", LAST),),
        disturbances={"actuator_delay": 1, "sensor_noise": {"leg_rate": 0.1}},
        task={"distance_weight": 3.0},
        hyperparameters={"n_envs": 2, "n_steps": 32, "batch_size": 32},
    )
    cell = Cell(Row("rough", "rough", DISTURBED, trial), 0, protocol=FEW)
    found = cell.run(tmp_path)
    assert list(found.policies) == [
        *("last: undisturbed", "last: actuator delay", "last: sensor noise"),
        "last: all disturbances",
    ]
    record = read_record(tmp_path / "rough_0" / LAST)
    assert record["disturbances"]["actuator_delay"] == 1
    assert record["task"]["distance_weight"] == 3.0
    other = dataclasses.replace(trial, task={"distance_weight": 4.0})
    assert other.settings != trial.settings
    assert hash(cell.row) == hash(dataclasses.replace(cell.row))  # rows are keys of the tables


def test_a_clone_is_made_and_fine_tuned_in_its_own_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def trained(*given: Any, **arguments: Any) -> TrainResult:
        asked.append((given, arguments))
        return TrainResult(tmp_path, tmp_path, tmp_path, 0, False, (), ())

    monkeypatch.setattr(trials, "train", trained)
    task = {"distance_weight": 0.1}
    trial = Trained("ppo", IMITATION, 64, cloning={"labels": 8000}, task=task)
    trial.train(7, tmp_path / "clone_7", BUILDABLE)
    [(given, arguments)] = asked
    assert given[1] == IMITATION
    assert arguments["cloning"] == dataclasses.replace(Cloning(), labels=8000)
    assert (arguments["timesteps"], arguments["task"]) == (64, task)
    for other in ({"cloning": {}}, {"task": {}}):
        assert trial.settings != dataclasses.replace(trial, **other).settings


def test_another_default_of_cloning_makes_another_trial_of_what_imitates_and_of_nothing_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clone, scratch = Trained("ppo", IMITATION, 0), Trained("ppo")
    before = clone.settings, scratch.settings

    @dataclasses.dataclass(frozen=True)
    class Other(Cloning):
        labels: int = 50_000

    monkeypatch.setattr(trials, "Cloning", Other)
    assert clone.settings["cloning"] == before[0]["cloning"] | {"labels": 50_000}
    assert scratch.settings == before[1]


def test_a_brief_cloning_has_one_round_and_keeps_its_other_differences() -> None:
    trial = Trained("ppo", IMITATION, 0, cloning={"gradient_steps": 9000, "log_std": -3.5}).brief()
    cloning = trial.cloned
    assert cloning is not None
    assert (cloning.rounds, cloning.log_std) == (1, -3.5)
    assert cloning.gradient_steps < 100
