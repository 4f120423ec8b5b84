"""TorchRL's wrappers around the environment."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import rimless_gym

pytestmark = pytest.mark.peers
pytest.importorskip("torchrl")

import torch  # noqa: E402
from torchrl.envs import GymEnv, GymWrapper  # noqa: E402
from torchrl.envs.utils import check_env_specs  # noqa: E402


def test_its_specifications_fit_what_the_environment_gives():
    env = GymEnv("RimlessWheel-v0")
    check_env_specs(env, seed=0)
    assert tuple(env.observation_spec["observation"].shape) == (6,)
    assert env.action_spec.space.low.item() == -1
    assert env.action_spec.space.high.item() == 1


def test_a_rollout_is_the_episode_that_gymnasium_gives():
    task = rimless_gym.Task(distance_weight=0.7)
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


def test_the_native_rows_are_stepped_and_reset_as_single_ones():
    n, limit = 3, 25
    # TorchRL prefers this mode; with SAME_STEP it resets once more where all rows end together.
    settings = {"autoreset_mode": AutoresetMode.DISABLED, "max_episode_steps": limit}
    rows = gym.make_vec("RimlessWheel-v0", num_envs=n, **settings)
    env = GymWrapper(rows)
    check_env_specs(env)
    env.set_seed(7)
    alone = [gym.make("RimlessWheel-v0", max_episode_steps=limit) for _ in range(n)]
    for i, each in enumerate(alone):
        each.reset(seed=7 + i)  # as set_seed does, before the rollout's own reset
    observations = [each.reset()[0] for each in alone]
    commands = np.random.default_rng(1).uniform(-0.5, 0.5, (60, n, 1)).astype(np.float32)
    given = iter(commands)
    seen = env.rollout(
        60,
        policy=lambda observation: torch.from_numpy(next(given)),
        break_when_any_done=False,
    )
    for k in range(60):
        for i, each in enumerate(alone):
            np.testing.assert_array_equal(seen["observation"][i, k].numpy(), observations[i])
            observations[i], _, terminated, truncated, _ = each.step(commands[k, i])
            after = seen["next"][i, k]
            np.testing.assert_array_equal(after["observation"].numpy(), observations[i])
            assert after["truncated"].item() == truncated
            if terminated or truncated:
                observations[i], _ = each.reset()
    assert seen["next", "truncated"].sum() >= n
