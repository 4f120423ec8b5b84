"""A simple controller, short trainings and one thread for the tests of learning."""

import dataclasses

import numpy as np
import pytest
import torch

from agents import training
from agents.conditions import Conditions
from agents.learner import Training, learner_class
from rimless_gym import THESIS_PHYSICAL, Task
from tests.agents.runs import run


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def few_evaluations(monkeypatch):
    """Evaluations and saved states take half of a short training."""
    monkeypatch.setattr(training, "EVALUATIONS", 4)


@pytest.fixture
def swing():
    """A smooth law in volts that swings the pendulum; it need not walk."""

    def controller(x, mode):
        return 6 * np.tanh(2 * np.sin(x[:, 1]) + x[:, 3] - x[:, 2])

    return controller


@pytest.fixture
def new_learner():
    """Makes a learner with the networks of the published hyperparameters in two environments."""

    def make(algo="ppo", seed=0, task=None):
        kind = learner_class(algo)
        settings = dataclasses.replace(kind.settings("imitation"), n_envs=2)
        conditions = Conditions(THESIS_PHYSICAL)
        return kind(Training(algo, "scratch", seed, conditions, task or Task(), settings))

    return make


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """The folder of a short PPO training that is over; not to be changed."""
    out = tmp_path_factory.mktemp("finished")
    run(out, timesteps=128)
    return out
