"""Trials that begin with what another row of the same seed has learned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from agents.folder import BEST, CLONE, LAST
from agents.train import TrainResult
from agents.training import IMITATION
from rimless_gym import BUILDABLE
from rimless_gym.commands.studies import trials
from rimless_gym.commands.studies.successors import Continued, Distilled, WentOn
from rimless_gym.commands.studies.trials import RESULT


def test_a_distilled_policy_is_taught_by_the_other_row_of_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    def trained(algo: str, init: str, seed: int, out: Path, **others: Any) -> TrainResult:
        asked.append(others)
        return TrainResult(out / BEST, out / LAST, out / CLONE, 0, False, (), ())

    monkeypatch.setattr(trials, "train", trained)
    trial = Distilled("ppo", IMITATION, 0, teacher="evolution")
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
    begun: list[str] = []

    def training(algo: str, init: str, seed: int, out: Path, **options: Any) -> Any:
        begun.append(init)
        raise KeyboardInterrupt

    monkeypatch.setattr(trials, "train", training)
    trial = kind("ppo", IMITATION, 64, (("", BEST),), begun="imitation")
    folder = tmp_path / "fine_tuned_3"
    folder.mkdir()
    with pytest.raises(ValueError, match=r"imitation_3 is not finished.*run --rows imitation"):
        trial.train(3, folder, BUILDABLE)
    other = tmp_path / "imitation_3"
    other.mkdir()
    (other / RESULT).write_text("{}")
    with pytest.raises(KeyboardInterrupt):
        trial.train(3, folder, BUILDABLE)
    assert begun == [str(other / file)]
