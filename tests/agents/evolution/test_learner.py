from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from agents.evaluate import evaluate
from agents.evolution.settings import EvolutionSettings
from agents.policies import learned_policy
from agents.policy_files import load_policy
from agents.protocol import SHORT_PROTOCOL
from agents.session import Session
from agents.train import train
from tests.agents.runs import BRIEF, scalars, small

SMALL = small("evolution")


def run(out, **changes):
    return train(
        "evolution", out=out, progress=False, **{"settings": SMALL, "protocol": BRIEF, **changes}
    )


def weights(path):
    return load_policy(path).parts.weights["weights"]


def test_it_logs_price_family_and_gait(tmp_path):
    run(tmp_path, timesteps=5_000_000)
    shown = scalars(tmp_path)
    assert {"evolution/price", "evolution/family", "evolution/worth", "eval/cot"} <= set(shown)


@pytest.mark.slow
def test_from_nothing_it_walks_from_most_starts_without_slipping(tmp_path):
    settings = EvolutionSettings(screened=4000, contenders=3, n_timesteps=150_000_000)
    result = run(tmp_path, settings=settings, protocol=SHORT_PROTOCOL)
    walk = evaluate(learned_policy(load_policy(result.best).act), protocol=SHORT_PROTOCOL)
    assert walk.walking_share > 0.6
    assert walk.cot < 1.0


def test_killed_and_resumed_it_ends_with_the_same_policy(tmp_path, monkeypatch):
    whole = run(tmp_path / "whole", timesteps=2_500_000)
    advanced, calls = Session.advanced, []

    def killed(self):
        calls.append(1)
        if len(calls) == 30:
            raise SystemExit
        advanced(self)

    monkeypatch.setattr(Session, "advanced", killed)
    with pytest.raises(SystemExit):
        run(tmp_path / "broken", timesteps=2_500_000)
    monkeypatch.setattr(Session, "advanced", advanced)
    resumed = run(tmp_path / "broken", timesteps=2_500_000)
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))
    np.testing.assert_array_equal(weights(resumed.best), weights(whole.best))


def test_it_goes_on_from_a_policy(tmp_path):
    first = run(tmp_path / "a", timesteps=2_000_000)
    second = run(tmp_path / "b", init=first.last, timesteps=0)
    np.testing.assert_array_equal(weights(second.last), weights(first.last))


def test_what_it_cannot_train_with_is_refused(tmp_path):
    with pytest.raises(ValueError, match="nominal machine without disturbances"):
        run(tmp_path / "a", ranges={"pendulum_mass": (1.5, 1.7)})
    with pytest.raises(ValueError, match="this learner cannot imitate"):
        run(tmp_path / "b", init="imitation", expert=lambda x, mode: x[:, 0])
    other = dataclasses.replace(SMALL, population=9)
    run(tmp_path / "c", timesteps=0)
    with pytest.raises(ValueError, match="hyperparameters"):
        run(tmp_path / "c", settings=other, timesteps=0)
