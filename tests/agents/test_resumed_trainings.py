"""A training that was stopped at any moment goes on to the same end."""

import errno
import os
import signal

import numpy as np
import pytest

from agents import session
from agents.learners import ppo
from agents.policy_files import read_record
from agents.sb3 import callbacks
from agents.session import Session
from tests.agents.runs import QUICK, STEPS, assert_same_policies, run, scalars, weights

ROUGH = {
    "ranges": {"pendulum_mass": (2.0, 2.4)},
    "disturbances": {
        "pushes": {"rate": 2.0, "impulse": (0.1, 0.3)},
        "sensor_noise": {"leg_rate": 0.1},
        "actuator_delay": (0, 2),
    },
}


@pytest.mark.parametrize(
    ("algo", "rollouts", "conditions"),
    [
        ("ppo", 1, {}),
        ("ppo", 4, ROUGH),
        ("sac", 4, ROUGH),
        pytest.param("ppo", 4, {}, marks=pytest.mark.slow),
        pytest.param("sac", 1, {}, marks=pytest.mark.slow),
        pytest.param("sac", 4, {}, marks=pytest.mark.slow),
    ],
)
def test_a_training_that_was_stopped_ends_with_the_same_policies(
    tmp_path, monkeypatch, algo, rollouts, conditions
):
    whole = run(tmp_path / "whole", algo, timesteps=2 * STEPS[algo], **conditions)
    between = Session.between
    seen = []

    def ask(self):
        seen.append(len(seen))
        if len(seen) > rollouts:
            signal.raise_signal(signal.SIGTERM if algo == "sac" else signal.SIGINT)
        between(self)

    monkeypatch.setattr(Session, "between", ask)
    broken = run(tmp_path / "broken", algo, timesteps=2 * STEPS[algo], **conditions)
    monkeypatch.setattr(Session, "between", between)
    assert broken.interrupted
    assert 0 < broken.timesteps < whole.timesteps
    assert read_record(broken.last)["timesteps"] == broken.timesteps
    resumed = run(tmp_path / "broken", algo, timesteps=2 * STEPS[algo], **conditions)
    assert (resumed.interrupted, resumed.timesteps) == (False, whole.timesteps)
    assert_same_policies(resumed, whole)


def test_what_was_logged_after_the_last_state_is_logged_once(tmp_path, monkeypatch):
    advanced, seen = Session.advanced, []

    def killed(self):
        seen.append(len(seen))
        if len(seen) > 200:  # of two environments
            raise SystemExit
        advanced(self)

    monkeypatch.setattr(Session, "advanced", killed)
    monkeypatch.setattr(session, "EVALUATIONS", 2)  # and so few states
    monkeypatch.setattr(callbacks, "LOG_INTERVALS", 1)
    with pytest.raises(SystemExit):
        run(tmp_path)
    monkeypatch.setattr(Session, "advanced", advanced)
    run(tmp_path)
    steps = [event.step for event in scalars(tmp_path)["walk/return"]]
    assert steps == [128, 256, 384, 512]


def test_a_training_killed_while_its_state_is_written_goes_on_from_the_one_before(
    tmp_path, monkeypatch
):
    whole = run(tmp_path / "whole")
    replaced, states = os.replace, []

    def killed(source, target):
        if str(target).endswith("state.npz"):
            states.append(target)
            if len(states) == 2:
                raise SystemExit  # as it stands, half written beside the last one
        replaced(source, target)

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(SystemExit):
        run(tmp_path / "killed")
    monkeypatch.setattr(os, "replace", replaced)
    resumed = run(tmp_path / "killed")
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))


def test_a_full_disk_ends_a_training_with_its_last_state_kept(tmp_path, monkeypatch):
    whole = run(tmp_path / "whole")
    written, count = np.savez_compressed, []

    def full(file, **arrays):
        count.append(file)
        if len(count) > 5:
            file.write(b"half of it")
            raise OSError(errno.ENOSPC, "No space left on device")
        written(file, **arrays)

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="No space left"):
        run(tmp_path / "full")
    assert not list((tmp_path / "full").glob("*.part"))
    monkeypatch.setattr(np, "savez_compressed", written)
    resumed = run(tmp_path / "full")
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))


def test_the_third_ctrl_c_stops_at_once_and_tells_what_is_kept(tmp_path, monkeypatch):
    advanced, seen = Session.advanced, []

    def hammer(self):
        seen.append(len(seen))
        if len(seen) == 100:
            for _ in range(3):
                signal.raise_signal(signal.SIGINT)
        advanced(self)

    monkeypatch.setattr(Session, "advanced", hammer)
    broken = run(tmp_path)
    assert broken.interrupted
    assert broken.timesteps == read_record(broken.last)["timesteps"] == 128
    monkeypatch.setattr(Session, "advanced", advanced)
    assert not run(tmp_path).interrupted


def test_a_request_in_the_last_moments_is_not_lost(tmp_path, monkeypatch):
    learn = ppo.Learner.learn

    def then_ask(self, until, watch):
        learn(self, until, watch)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(ppo.Learner, "learn", then_ask)
    result = run(tmp_path)
    assert (result.interrupted, result.timesteps) == (True, STEPS["ppo"])
    assert not run(tmp_path).interrupted


def test_a_clone_is_kept_until_the_training_has_a_state(tmp_path, swing, monkeypatch):
    whole = run(tmp_path / "whole", init="imitation", expert=swing, cloning=QUICK)

    def killed(*arguments):
        raise SystemExit

    monkeypatch.setattr(session, "write_state", killed)
    with pytest.raises(SystemExit):
        run(tmp_path / "killed", init="imitation", expert=swing, cloning=QUICK)
    monkeypatch.undo()

    def never(x, mode):
        raise AssertionError("the expert is asked again")

    resumed = run(tmp_path / "killed", init="imitation", expert=never, cloning=QUICK)
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))
    assert not (tmp_path / "killed" / "cloning.npz").exists()


def test_a_training_killed_before_its_first_state_begins_anew(folder, finished):
    (folder / "state.npz").unlink()
    run(folder, timesteps=128)
    np.testing.assert_array_equal(weights(folder / "last.zip"), weights(finished / "last.zip"))


def test_a_training_that_is_over_is_left_alone_unless_more_is_asked_for(folder):
    before = (folder / "state.npz").read_bytes()
    again = run(folder, timesteps=128)
    assert (again.timesteps, again.evaluations) == (128, ())
    assert (folder / "state.npz").read_bytes() == before
    assert run(folder, timesteps=256).timesteps == 256
