"""TorchRL's wrappers around the environment."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import rimless_gym

pytestmark = pytest.mark.peers
pytest.importorskip("torchrl")

import torch  # noqa: E402
from torchrl.envs import GymEnv  # noqa: E402
from torchrl.envs.utils import check_env_specs  # noqa: E402


def test_its_specifications_fit_what_the_environment_gives():
    env = GymEnv("RimlessWheel-v0")
    check_env_specs(env, seed=0)
    assert tuple(env.observation_spec["observation"].shape) == (6,)
    assert env.action_spec.space.low.item() == -1
    assert env.action_spec.space.high.item() == 1


def test_a_rollout_is_the_episode_that_gymnasium_gives():
    task = rimless_gym.Task(value_of_distance=0.7)
    env, alone = GymEnv("RimlessWheel-v0", task=task), gym.make("RimlessWheel-v0", task=task)
    env.set_seed(5)
    alone.reset(seed=5)  # as set_seed does, before the rollout's own reset
    observation, _ = alone.reset()
    commands = np.random.default_rng(0).uniform(-0.3, 0.3, (300, 1)).astype(np.float32)
    given = iter(commands)
    seen = env.rollout(300, policy=lambda observation: torch.from_numpy(next(given)))
    for k in range(len(seen)):
        np.testing.assert_array_equal(seen["observation"][k].numpy(), observation)
        observation, reward, terminated, truncated, _ = alone.step(commands[k])
        after = seen["next"][k]
        np.testing.assert_array_equal(after["observation"].numpy(), observation)
        assert after["reward"].item() == np.float32(reward)
        assert (after["terminated"].item(), after["truncated"].item()) == (terminated, truncated)
    assert terminated or len(seen) == 300
    assert len(seen) > 5
