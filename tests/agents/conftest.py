"""A simple controller, small settings and one thread for the tests of learning."""

import numpy as np
import pytest
import torch
from agents.hyperparameters import hyperparameters
from agents.training_env import training_env

from rimless_gym import THESIS_PHYSICAL, Task


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture
def swing():
    """A smooth law in volts that swings the pendulum; it need not walk."""

    def controller(x, mode):
        return 6 * np.tanh(2 * np.sin(x[:, 1]) + x[:, 3] - x[:, 2])

    return controller


@pytest.fixture
def new_model():
    def make(algo="ppo", seed=0, **changes):
        from agents.checkpoint import ALGORITHMS

        settings = hyperparameters(algo, imitation=True)
        env = training_env(2, THESIS_PHYSICAL, Task(), seed)
        if algo == "ppo":
            changes = {"batch_size": 64} | changes
        arguments = settings.algorithm | changes
        return ALGORITHMS[algo](env=env, seed=seed, device="cpu", **arguments)

    return make
