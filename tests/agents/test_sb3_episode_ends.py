"""Ends of episodes in Sb3VecEnv: out of time or fallen, and the last observation."""

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnvWrapper

from agents import Sb3VecEnv
from tests.agents.sb3_rows import native, whirling


class Recorded(VecEnvWrapper):
    """Keeps all rewards, and how the episodes of its rows ended."""

    def __init__(self, venv):
        super().__init__(venv)
        self.rewards, self.truncated, self.dones = [], [], []

    def reset(self):
        return self.venv.reset()

    def step_wait(self):
        observations, rewards, dones, infos = self.venv.step_wait()
        self.rewards.append(rewards.copy())
        self.dones.append(dones)
        self.truncated.append([info["TimeLimit.truncated"] for info in infos])
        return observations, rewards, dones, infos


def test_ppo_adds_the_value_of_the_last_state_after_a_timeout_but_not_after_a_fall():
    env = Recorded(Sb3VecEnv(native(8, max_episode_steps=30)))
    model = PPO("MlpPolicy", env, seed=0, device="cpu", n_steps=128, batch_size=64, n_epochs=1)
    with torch.no_grad():
        model.policy.log_std.fill_(2.0)  # full voltage this way or that: some fall
    model.learn(1)
    added = model.rollout_buffer.rewards != np.array(env.rewards)
    truncated, dones = np.array(env.truncated), np.array(env.dones)
    np.testing.assert_array_equal(added, truncated)
    assert truncated.any()
    assert (dones & ~truncated).any()


def test_a_last_observation_is_a_copy_that_later_steps_do_not_change():
    env = Sb3VecEnv(native(6, max_episode_steps=25))
    env.reset()
    kept = []
    for k in range(100):
        observations, _, dones, infos = env.step(whirling(6, k))
        for i in np.flatnonzero(dones):
            last = infos[i]["terminal_observation"]
            kept.append((last, last.copy()))
            assert not np.shares_memory(last, observations)
            assert not np.array_equal(last, observations[i])
    assert len(kept) >= 6 * 4
    for last, before in kept:
        np.testing.assert_array_equal(last, before)
