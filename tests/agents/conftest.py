"""A simple controller, short trainings and one thread for the tests of learning."""

import dataclasses
import shutil

import numpy as np
import pytest
import torch

from agents import learners, session
from agents.conditions import Conditions
from agents.training import Training
from rimless_gym import THESIS_PHYSICAL, Task
from tests.agents.runs import run


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def few_evaluations(monkeypatch):
    """Evaluations and the states that are saved with them take half of a short training."""
    monkeypatch.setattr(session, "EVALUATIONS", 4)


@pytest.fixture(autouse=True)
def short_films(monkeypatch):
    """So do the films of their policies: `test_film.py` looks at longer ones."""
    monkeypatch.setattr(session, "FILMED", 0.3)


@pytest.fixture
def swing():
    """A smooth law in volts that swings the pendulum; it need not walk."""

    def controller(x, mode):
        return 6 * np.tanh(2 * np.sin(x[:, 1]) + x[:, 3] - x[:, 2])

    return controller


@pytest.fixture
def new_learner():
    """Makes a learner with the networks of the published hyperparameters in two environments."""

    def make(algo="ppo", seed=0, task=None, **changes):
        kind = learners.learner(algo)
        settings = kind.settings("imitation")
        if algo == "ppo":
            changes = {"batch_size": 64} | changes
        settings = dataclasses.replace(settings, n_envs=2, algorithm=settings.algorithm | changes)
        conditions = Conditions(THESIS_PHYSICAL)
        return kind(Training(algo, "scratch", seed, conditions, task or Task(), settings))

    return make


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A short PPO training that is over; copy it before changing it."""
    out = tmp_path_factory.mktemp("finished")
    run(out, timesteps=128)
    return out


@pytest.fixture
def folder(finished, tmp_path):
    """A copy of it."""
    return shutil.copytree(finished, tmp_path / "training")
