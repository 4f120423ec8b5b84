from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from agents.evaluate import SHORT_PROTOCOL, evaluate
from agents.evolution.policy import SIZE
from agents.evolution.settings import EvolutionSettings
from agents.policy_files import FORMAT, load_policy
from agents.session import Session
from agents.train import train
from tests.agents.runs import BRIEF, SETTLED, STEPS, scalars, small
from trajopt.files import read_arrays, write_arrays

SMALL = small("evolution")

#: Random weights that do not walk.
IDLE = 1e-3 * np.random.default_rng(0).normal(size=SIZE)


def run(out, **changes):
    return train(
        "evolution",
        out=out,
        progress=False,
        **{"settings": SMALL, "protocol": BRIEF, "timesteps": STEPS["evolution"], **changes},
    )


def weights(path):
    return load_policy(path).parts.weights["weights"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A training that nothing disturbed; not to be changed."""
    return run(tmp_path_factory.mktemp("whole"))


@pytest.fixture
def idle(tmp_path, whole):
    """The file of a policy that does not walk."""
    record, _ = read_arrays(whole.last, FORMAT, ValueError, "")
    write_arrays(tmp_path / "idle.zip", FORMAT, record, {"weights": IDLE})
    return tmp_path / "idle.zip"


def killed_after(calls, monkeypatch, out, **changes):
    """Train until there are so many answers; those since the last state are lost."""
    advanced, seen = Session.advanced, []

    def killed(self):
        seen.append(1)
        if len(seen) == calls:
            raise SystemExit
        advanced(self)

    with monkeypatch.context() as patch:
        patch.setattr(Session, "advanced", killed)
        with pytest.raises(SystemExit):
            run(out, **changes)


def test_it_logs_price_family_and_gait(whole):
    shown = scalars(whole.last.parent)
    assert {"evolution/price", "evolution/family", "evolution/worth", "eval/objective"} <= set(
        shown
    )


@pytest.mark.slow
def test_from_nothing_it_walks_from_most_starts_without_slipping(tmp_path):
    settings = EvolutionSettings(screened=4000, contenders=3, n_timesteps=150_000_000)
    result = run(tmp_path, settings=settings, timesteps=None, protocol=SHORT_PROTOCOL)
    walk = evaluate(load_policy(result.best).policy, protocol=SHORT_PROTOCOL)
    assert walk.walking_share > 0.6
    assert walk.cot < 1.0


def test_killed_and_resumed_it_ends_with_the_same_policy(tmp_path, monkeypatch, whole):
    killed_after(30, monkeypatch, tmp_path)
    resumed = run(tmp_path)
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))
    np.testing.assert_array_equal(weights(resumed.best), weights(whole.best))


def test_it_goes_on_from_a_policy(tmp_path, whole):
    second = run(tmp_path, init=whole.last, timesteps=0)
    np.testing.assert_array_equal(weights(second.last), weights(whole.last))


def test_begun_from_a_policy_killed_and_resumed_it_ends_with_the_same_policy(tmp_path, monkeypatch):
    begun = {"init": "evolution", "timesteps": 400_000}
    undisturbed = run(tmp_path / "whole", **begun)
    killed_after(20, monkeypatch, tmp_path / "broken", **begun)
    resumed = run(tmp_path / "broken", **begun)
    assert not np.array_equal(weights(resumed.last), weights("evolution"))
    np.testing.assert_array_equal(weights(resumed.last), weights(undisturbed.last))
    np.testing.assert_array_equal(weights(resumed.best), weights(undisturbed.best))


def test_begun_from_a_policy_that_does_not_walk_it_goes_on_and_logs_no_gait(tmp_path, idle):
    result = run(tmp_path / "out", init=idle, timesteps=200_000, protocol=SETTLED)
    assert result.timesteps >= 200_000
    assert result.best.exists()
    assert {evaluation.walking_share for _, evaluation in result.evaluations} == {0.0}
    shown = scalars(tmp_path / "out")
    assert not {"eval/cot", "eval/speed", "walk/cot"} & set(shown)
    assert all(np.isfinite(event.value) for events in shown.values() for event in events)


def test_what_it_cannot_train_with_is_refused(tmp_path):
    with pytest.raises(ValueError, match="nominal machine without disturbances"):
        run(tmp_path / "a", ranges={"pendulum_mass": (1.5, 1.7)})
    with pytest.raises(ValueError, match="cannot imitate"):
        run(tmp_path / "b", init="imitation", expert=lambda x, mode: x[:, 0])
    other = dataclasses.replace(SMALL, population=9)
    run(tmp_path / "c", timesteps=0)
    with pytest.raises(ValueError, match="hyperparameters"):
        run(tmp_path / "c", settings=other, timesteps=0)


def test_a_shipped_policy_walks_without_what_only_learning_needs() -> None:
    code = (
        "import sys; sys.modules.update(cma=None, torch=None, stable_baselines3=None)\n"
        "from agents import load_policy; import numpy as np\n"
        "print(load_policy('evolution').act(np.zeros((1, 6), np.float32)).shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "(1,)\n"
