"""Trials that begin with what another row of the same seed has learned."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from agents.folder import BEST, CLONE, LAST
from agents.train import TrainResult
from agents.training import IMITATION
from rimless_gym import BUILDABLE
from scripts.studies.learning import trials
from scripts.studies.learning.row import Row
from scripts.studies.learning.rows import LEARNED
from scripts.studies.learning.successors import Continued, Distilled, Successor, WentOn
from scripts.studies.learning.trials import RESULT, Trained

EVOLUTION = Row("evolution", "evolution", LEARNED, Trained("evolution"))
CLONE_ROW = Row("imitation", "imitation", LEARNED, Trained("ppo", IMITATION, 0))


def test_a_distilled_policy_is_taught_by_the_other_row_of_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    def trained(algo: str, init: str, seed: int, out: Path, **others: Any) -> TrainResult:
        asked.append(others)
        return TrainResult(out / BEST, out / LAST, out / CLONE, 0, False, (), ())

    monkeypatch.setattr(trials, "train", trained)
    trial = Distilled("ppo", IMITATION, 0, before=EVOLUTION)
    (own := tmp_path / "distilled_3").mkdir()
    with pytest.raises(ValueError, match=r"evolution_3 is not finished.*--rows evolution"):
        trial.train(3, own, BUILDABLE)
    (tmp_path / "evolution_3").mkdir()
    (tmp_path / "evolution_3" / RESULT).touch()
    trial.train(3, own, BUILDABLE)
    assert asked[0]["expert"] == str(tmp_path / "evolution_3" / BEST)


@pytest.mark.parametrize(("kind", "file"), [(Continued, CLONE), (WentOn, LAST)])
def test_a_row_goes_on_from_a_policy_of_the_same_seed(
    kind: type[Continued], file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[tuple[str, Any]] = []

    def training(algo: str, init: str, seed: int, out: Path, **options: Any) -> Any:
        begun.append((init, options["cloning"]))
        raise KeyboardInterrupt

    monkeypatch.setattr(trials, "train", training)
    trial = kind("ppo", IMITATION, 64, (("", BEST),), before=CLONE_ROW)
    folder = tmp_path / "fine_tuned_3"
    folder.mkdir()
    with pytest.raises(ValueError, match=r"imitation_3 is not finished.*run --rows imitation"):
        trial.train(3, folder, BUILDABLE)
    other = tmp_path / "imitation_3"
    other.mkdir()
    (other / RESULT).write_text("{}")
    with pytest.raises(KeyboardInterrupt):
        trial.train(3, folder, BUILDABLE)
    assert begun == [(str(other / file), None)]  # it clones no more


@pytest.mark.parametrize("kind", [Distilled, Continued, WentOn])
def test_another_trial_of_the_row_before_makes_another_one_of_the_row_that_needs_it(
    kind: type[Successor],
) -> None:
    trial = kind("ppo", IMITATION, 64, before=CLONE_ROW)
    other = dataclasses.replace(CLONE_ROW, trial=Trained("ppo", IMITATION, 0, task={"idle": 1.0}))
    assert dataclasses.replace(trial, before=other).settings != trial.settings
    assert trial.settings["before"]["trial"] == CLONE_ROW.trial.settings
    assert trial.brief().settings["before"]["trial"] == CLONE_ROW.trial.brief().settings
    titled = dataclasses.replace(CLONE_ROW, title="a clone")  # which is not how it was trained
    assert dataclasses.replace(trial, before=titled).settings == trial.settings
