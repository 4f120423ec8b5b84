"""A new learner is one file: here one without gradients and without stable-baselines3."""

import dataclasses
import signal
from pathlib import Path

import numpy as np
import pytest

from agents import learners
from agents.cli import evaluate as evaluate_script
from agents.cli import train as train_script
from agents.comparison.arena import Arena
from agents.comparison.learned import Learned
from agents.comparison.study import Study
from agents.evaluate import evaluate
from agents.policies import learned_policy
from agents.policy_files import FORMAT, CheckpointError, load_policy
from agents.session import Session
from agents.train import train
from tests.agents.runs import BRIEF, scalars
from trajopt.files import read_arrays, write_arrays

FOLDER = Path(__file__).parent / "more_learners"


@pytest.fixture(autouse=True)
def one_more(monkeypatch):
    """Let learners be found in this folder too."""
    monkeypatch.setattr(learners, "__path__", [*learners.__path__, str(FOLDER)])


def run(out, **changes):
    return train("cem", out=out, protocol=BRIEF, progress=False, **changes)


def mean(path):
    return load_policy(path).parts.weights["mean"]


def test_a_learner_is_found_by_the_name_of_its_file():
    assert learners.names() == ["cem", "evolution", "ppo", "sac", "screened_ppo"]


def test_it_trains_saves_loads_and_is_evaluated(tmp_path):
    result = run(tmp_path)
    assert result.timesteps == 4000
    loaded = load_policy(result.last)
    assert loaded.algo == "cem"
    assert loaded.record["observation_layout"]
    assert evaluate(learned_policy(loaded.act), protocol=BRIEF).protocol == BRIEF
    shown = scalars(tmp_path)
    assert {"walk/return", "energy/copper", "eval/objective"} <= set(shown)
    with pytest.raises(AttributeError):
        _ = loaded.model


def test_its_training_ends_with_the_same_policy_after_being_stopped_or_killed(
    tmp_path, monkeypatch
):
    whole = run(tmp_path / "whole")
    advanced, calls = Session.advanced, []

    def killed(self):
        calls.append(1)
        if len(calls) == 120:
            raise SystemExit
        if len(calls) == 20:
            signal.raise_signal(signal.SIGTERM)
        advanced(self)

    monkeypatch.setattr(Session, "advanced", killed)
    stopped = run(tmp_path / "broken")
    assert (stopped.interrupted, stopped.timesteps) == (True, 1000)
    with pytest.raises(SystemExit):
        run(tmp_path / "broken")
    monkeypatch.setattr(Session, "advanced", advanced)
    resumed = run(tmp_path / "broken")
    for name in ("best", "last"):
        np.testing.assert_array_equal(mean(getattr(resumed, name)), mean(getattr(whole, name)))


def test_it_starts_only_from_its_own_policies_and_refuses_to_imitate(tmp_path):
    first = run(tmp_path / "a", timesteps=1000)
    second = run(tmp_path / "b", init=first.last, timesteps=0)
    np.testing.assert_array_equal(mean(second.last), mean(first.last))
    with pytest.raises(CheckpointError, match="a policy of ppo, which cannot start cem"):
        run(tmp_path / "c", init="fine_tuned", params=load_policy("fine_tuned").params)
    with pytest.raises(ValueError, match="cannot imitate; begin from 'scratch'"):
        run(tmp_path / "d", init="imitation", expert=lambda x, mode: x[:, 0])


def test_its_settings_identify_its_training(tmp_path):
    run(tmp_path, timesteps=1000)
    settings = dataclasses.replace(learners.learner("cem").settings("scratch"), elite=3)
    with pytest.raises(ValueError, match="hyperparameters"):
        run(tmp_path, settings=settings, timesteps=1000)


def test_its_policy_without_weights_is_refused(tmp_path):
    result = run(tmp_path, timesteps=0)
    record, _ = read_arrays(result.last, FORMAT, ValueError, "")
    write_arrays(result.last, FORMAT, record, {})
    with pytest.raises(CheckpointError, match="weights do not fit a cem policy"):
        load_policy(result.last)


def test_the_command_lines_know_it(tmp_path, monkeypatch, capsys):
    assert train_script.main(["--algo", "cem", "--out", str(tmp_path), "--timesteps", "1000"]) == 0
    monkeypatch.setattr(
        evaluate_script, "evaluate", lambda *args, **kw: evaluate(*args, BRIEF, **kw)
    )
    assert evaluate_script.main([str(tmp_path / "last.zip"), "--no-gap"]) == 0
    assert "last.zip" in capsys.readouterr().out


@pytest.mark.slow
def test_it_enters_the_comparison_with_one_entry(tmp_path):
    entrant = Learned(
        "cem", "scratch", {"cross-entropy": "best.zip"}, algo="cem", budget="timesteps"
    )
    result = entrant.compete(Arena(Study(timesteps=1000), tmp_path, progress=False))
    assert result["timesteps"] == 1000
    assert "walking_share" in result["evaluation"]
