"""What is paid while a wheel sets off, and how much that counts."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from agents.conditions import Conditions
from agents.sb3.layers import layer_of
from agents.sb3.setting_off import LIMIT, CountApart, SettingOff, alike
from agents.sb3.training_env import Offer, begin_out_of_step, training_env
from rimless_gym import Task

SETTING_OFF = 5


def made(n, intervals, travel=0.0, episode_steps=None):
    layers = {SettingOff: {"intervals": intervals, "travel": travel}}
    return training_env(n, Conditions(), Task(), 7, Offer(layers, episode_steps))


@pytest.mark.parametrize("travel", [0.0, 0.2])
def test_at_first_energy_is_free_and_travel_counts_less_but_falls_and_slips_do_not(travel):
    paid, plain = made(16, SETTING_OFF, travel=travel), made(16, 0)
    np.testing.assert_array_equal(paid.reset(), plain.reset())
    ages, seen = np.zeros(16, dtype=int), set()
    rng = np.random.default_rng(0)
    for _ in range(150):
        actions = rng.choice([-1.0, 1.0], size=(16, 1)).astype(np.float32)
        (_, rewards, dones, infos), (_, whole, _, _) = paid.step(actions), plain.step(actions)
        for i in range(16):
            charges = infos[i]["reward_slip"] + infos[i]["reward_end"]
            early = ages[i] < SETTING_OFF
            expected = travel * infos[i]["reward_distance"] + charges if early else whole[i]
            assert rewards[i] == pytest.approx(expected, abs=1e-7)
            seen.add((bool(early), charges < 0.0))
        ages = np.where(dones, 0, ages + 1)
    assert len(seen) == 4


def test_episodes_may_be_shorter_than_the_environments_own():
    env = made(4, 2, episode_steps=6)
    env.reset()
    for k in range(6):
        _, _, dones, infos = env.step(np.zeros((4, 1), dtype=np.float32))
        assert (dones == (k == 5)).all()
    assert all(info["TimeLimit.truncated"] for info in infos)


class Spreads(BaseCallback):
    """Notes means and spreads of advantages: of setting off, of walking, and of stalled wheels."""

    def __init__(self):
        super().__init__()
        self.ages, self.early, self.steps, self.found = np.zeros(8, dtype=int), [], 0, []

    def _on_step(self):
        self.early.append(self.ages < SETTING_OFF)
        self.ages = np.where(self.locals["dones"], 0, self.ages + 1)
        self.steps = self.steps + np.array([info["steps"] for info in self.locals["infos"]])
        return True

    def _on_rollout_end(self):
        advantages, early = self.locals["rollout_buffer"].advantages, np.array(self.early)
        parts = [early, ~early & (self.steps > 0), ~early & (self.steps <= 0)]
        self.found += [[(advantages[part].mean(), advantages[part].std()) for part in parts]]
        self.early, self.steps = [], 0


def test_advantages_of_setting_off_of_walking_and_of_stalled_wheels_have_the_same_spread():
    env = made(8, SETTING_OFF, episode_steps=50)
    settings = {"n_steps": 64, "batch_size": 64, "n_epochs": 1, "normalize_advantage": False}
    spreads = Spreads()
    PPO("MlpPolicy", env, device="cpu", seed=0, **settings).learn(
        2048, [CountApart(layer_of(env, SettingOff)), spreads]
    )
    assert len(spreads.found) == 4
    np.testing.assert_allclose(spreads.found, [[(0.0, 1.0)] * 3] * 4, atol=1e-4)


def test_rare_advantages_do_not_hide_the_usual_ones():
    usual = np.random.default_rng(0).normal(size=1000)
    rare = np.array([-1000.0, 400.0])
    found = alike(np.concatenate([usual, rare]))
    assert found[:1000].std() > 0.85
    assert np.corrcoef(found[:1000], usual)[0, 1] > 0.999
    assert found.std() == pytest.approx(1.0)
    assert np.abs(found[1000:]) == pytest.approx(LIMIT, rel=0.15)


def test_advantages_that_are_all_the_same_are_none():
    np.testing.assert_allclose(alike(np.full(5, 3.0)), 0.0)


def test_rows_that_begin_out_of_step_are_of_all_ages():
    env = made(40, SETTING_OFF, episode_steps=20)
    seen = begin_out_of_step(env, lambda observations: np.zeros(len(observations)))
    assert seen.shape == (40, 6)
    ages = layer_of(env, SettingOff).monitor.episode_lengths.copy()
    assert np.bincount(ages, minlength=20).tolist() == [2] * 20
    for k in range(20):  # each ends when its own time is over
        _, _, dones, _ = env.step(np.zeros((40, 1), dtype=np.float32))
        np.testing.assert_array_equal(dones, ages == 19 - k)


def test_what_it_cannot_pay_in_is_refused():
    with pytest.raises(TypeError, match=r"must be a VecMonitor around an agents\.Sb3VecEnv"):
        SettingOff(VecMonitor(DummyVecEnv([lambda: gym.make("RimlessWheel-v0")])), 5)
    with pytest.raises(ValueError, match=r"intervals = 2000: an episode has 2000, .*give fewer"):
        made(1, 2000)
    with pytest.raises(ValueError, match=r"intervals = 300: an episode has 200, .*give fewer"):
        made(1, 300, episode_steps=200)
    with pytest.raises(ValueError, match="intervals = -1"):
        made(1, -1)
    with pytest.raises(ValueError, match="travel = 2: a share of the travel, must be at most 1"):
        made(1, 5, travel=2.0)
