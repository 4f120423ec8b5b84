"""Gradients through the simulator lower the cost of a walk, and go on after a kill."""

import os

import numpy as np
import pytest

from agents.evaluate import Protocol
from agents.policy_files import PRETRAINED
from tests.agents.runs import assert_same_policies, killed_after, run, weights

os.environ.setdefault("XLA_FLAGS", "--xla_disable_hlo_passes=fusion")  # compiles twice as fast
pytest.importorskip("jax")
from agents.sb3 import gradients

#: A walk at more than twice the least cost, so that a few updates lower it.
START = str(PRETRAINED["robust"])


@pytest.fixture
def short(monkeypatch):
    for name, value in {"ROWS": 8, "HORIZON": 42, "SHOWN_STARTS": 8, "TIED": 64}.items():
        monkeypatch.setattr(gradients, name, value)
    gradients._differentiated.cache_clear()
    yield
    gradients._differentiated.cache_clear()


@pytest.mark.slow
def test_a_policy_walks_at_less_cost_and_a_killed_training_goes_on(tmp_path, monkeypatch, short):
    protocol = Protocol(starts=8, seed=1, duration=6.0, window=3.0, alive=3.0)

    def begin(name):
        steps = 10 * gradients.ROWS * 2 * gradients.HORIZON
        return run(tmp_path / name, "gradients", init=START, timesteps=steps, protocol=protocol)

    whole = begin("whole")
    assert 0 < np.abs(weights(whole.last) - weights(START)).max() < 0.01
    assert min(each.cot for each in whole.curve) < 0.99 * whole.curve[0].cot
    killed_after(2, monkeypatch, lambda: begin("broken"))
    assert_same_policies(begin("broken"), whole)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "goes on from a policy that walks; begin from 'imitation'"),
        ({"init": START, "ranges": {"pendulum_mass": (1.5, 1.8)}}, "leave out ranges"),
        ({"init": START, "hyperparameters": {"gamma": 0.9}}, "'gamma' is not known"),
        (
            {"init": "imitation", "hyperparameters": {"policy_kwargs": {"activation_fn": "ReLU"}}},
            "'ReLU': gradients needs layers of Tanh",
        ),
    ],
)
def test_what_it_cannot_begin_from_is_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        run(tmp_path, "gradients", **changes)
