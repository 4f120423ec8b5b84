"""The search for hyperparameters: what it tries, how it continues, and what it writes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("optuna", reason="needs the extra tune")

from agents import tuning
from agents.training import DivergedError, Milestone, TrainResult
from agents.training_config import TrainingConfig

#: Of the trainings that are tried: that which is stopped, and that which diverges.
STOPPED, DIVERGED = 2, 1

CONFIG = TrainingConfig("ppo", timesteps=1000, hyperparameters={"gamma": 0.97})


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Hyperparameters of trainings, whose walks cost least at a learning rate of 0.001."""
    tried: list[Any] = []

    def train(config: TrainingConfig, out: Path, **_: Any) -> TrainResult:
        tried.append(config.hyperparameters)
        if len(tried) - 1 == STOPPED:
            raise KeyboardInterrupt
        if len(tried) - 1 == DIVERGED:
            raise DivergedError("too fast")
        cot = 0.05 + abs(math.log(tried[-1]["learning_rate"] / 1e-3))
        return TrainResult(out, out, None, 1000, (Milestone(1000, 1.0, 1.0, 0.6, cot, 0.0),))

    monkeypatch.setattr(tuning, "train", train)
    return tried


def test_a_search_continues_after_a_stop_and_writes_the_best_entry(
    tried: list[Any], tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        tuning.tune(CONFIG, 6, tmp_path, workers=1)
    score = tuning.tune(CONFIG, 6, tmp_path, workers=1)
    assert len(tried) == 6 + 1
    assert tried[STOPPED] == tried[STOPPED + 1]  # begins again
    counted = [each for n, each in enumerate(tried) if n not in (STOPPED, DIVERGED)]
    best = min(counted, key=lambda each: abs(math.log(each["learning_rate"] / 1e-3)))
    entry = yaml.safe_load((tmp_path / tuning.BEST).read_text())["RimlessWheel-v0"]
    assert entry == {"n_envs": 8, "n_timesteps": 1000, "policy": "MlpPolicy", **best}
    assert {each["gamma"] for each in tried} == {0.97}  # as it was given
    assert tuning.tune(CONFIG, 6, tmp_path, workers=1) == score  # nothing is left to try
    with pytest.raises(ValueError, match="results of hyperparameters"):
        tuning.tune(TrainingConfig("ppo", timesteps=1000), 6, tmp_path)


def test_with_a_prior_no_bonus_for_entropy_is_searched(tried: list[Any], tmp_path: Path) -> None:
    tuning.tune(TrainingConfig("sac", timesteps=1000, prior="law"), 1, tmp_path, workers=1)
    assert "gamma" in tried[0]
    assert "ent_coef" not in tried[0]


def test_only_spaces_that_are_known_are_searched(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'evolution': only those of ppo, sac"):
        tuning.tune(TrainingConfig("evolution"), 1, tmp_path)
