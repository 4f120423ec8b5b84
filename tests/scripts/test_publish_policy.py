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
from scripts import publish_policy as command

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
    assert f"30 s. {command.AGAIN} `python" in card


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
