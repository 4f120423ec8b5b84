"""A policy that is not of the comparison comes into the package, with a card."""

from __future__ import annotations

import dataclasses
import json
import shutil
from functools import partial
from pathlib import Path

import pytest

from agents.evaluate import evaluate
from agents.policy_files import PRETRAINED
from agents.protocol import PROTOCOL
from agents.training import TrainingConfig, train
from scripts.studies import publish_policy as command

#: Long enough to walk.
FEW = dataclasses.replace(PROTOCOL, starts=4, duration=12.0, window=4.0, alive=2.0)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the package's policies."""
    (tmp_path / "package").mkdir()
    monkeypatch.setattr(command, "PRETRAINED", tmp_path / "package")
    monkeypatch.setattr(command, "evaluate", partial(evaluate, protocol=FEW))
    monkeypatch.setattr(command, "gap_to_optimum", lambda *given, progress: 0.123)
    return tmp_path / "package"


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    """A policy in the folder of its training."""
    (tmp_path / "training").mkdir()
    (tmp_path / "training" / "train.json").write_text(json.dumps({"init": "scratch"}))
    return Path(shutil.copy(PRETRAINED["evolution"], tmp_path / "training" / "best.zip"))


def test_a_policy_is_copied_and_gets_a_card_of_its_figures(package: Path, policy: Path) -> None:
    assert command.main(["found", str(policy), "found by evolution"]) == 0
    assert (package / "found.zip").read_bytes() == policy.read_bytes()
    card = (package / "found.md").read_text()
    assert card.startswith("# `found`: found by evolution\n\nLearned from nothing")
    assert "| starts that walk | 100% |" in card
    assert "| gap to the optimum at this speed | +12.3% |" in card
    assert f"30 s. {command.AGAIN} `rimless evaluate" in card


def test_nothing_is_published_of_a_policy_that_walks_from_no_start(
    package: Path,
    policy: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    brief = dataclasses.replace(FEW, starts=1, duration=0.2, window=0.1, alive=0.01)
    monkeypatch.setattr(command, "evaluate", partial(evaluate, protocol=brief))
    with pytest.raises(SystemExit):
        command.main(["found", str(policy), "found by evolution"])
    assert "walks from no start" in capsys.readouterr().err
    assert not list(package.iterdir())


@pytest.mark.slow
def test_a_policy_at_commanded_speeds_gets_a_card_with_a_line_for_each(
    package: Path, tmp_path: Path
) -> None:
    training = tmp_path / "training"
    training.mkdir()
    (training / "train.json").write_text(json.dumps({"init": "imitation with {}"}))
    policy = Path(shutil.copy(PRETRAINED["front"], training / "clone.zip"))
    assert command.main(["found", str(policy), "found by cloning"]) == 0
    card = (package / "found.md").read_text()
    for speed in (0.52, 0.54, 0.56, 0.58, 0.6, 0.62):
        assert f"| {speed:g} m/s | 100% |" in card


def test_a_policy_that_decides_more_rarely_than_the_optimum_is_refused(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = TrainingConfig("ppo", timesteps=0, speeds=(0.4, 0.6))
    trained = train(config, tmp_path / "t", progress=False)
    with pytest.raises(SystemExit):
        command.main(["found", str(trained.last), "found"])
    assert "--control-period 0.01" in capsys.readouterr().err
    assert not list(package.iterdir())
