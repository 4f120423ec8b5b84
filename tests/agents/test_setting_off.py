"""What is paid while a wheel sets off, and how much that counts."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from agents.conditions import Conditions
from agents.sb3.setting_off import CountApart, SettingOff
from agents.sb3.training_env import Offer, setting_off_of, training_env
from rimless_gym import Task

SETTING_OFF = 5


def made(n, setting_off, **offer):
    return training_env(n, Conditions(), Task(), 7, Offer(setting_off=setting_off, **offer))


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
    """Notes how far advantages of setting off, and all others, are spread."""

    def __init__(self):
        super().__init__()
        self.ages, self.early, self.found = np.zeros(8, dtype=int), [], []

    def _on_step(self):
        self.early.append(self.ages < SETTING_OFF)
        self.ages = np.where(self.locals["dones"], 0, self.ages + 1)
        return True

    def _on_rollout_end(self):
        advantages, early = self.locals["rollout_buffer"].advantages, np.array(self.early)
        self.found += [(advantages[early].std(), advantages[~early].std())]
        self.early = []


def test_advantages_of_setting_off_and_of_all_else_have_the_same_spread():
    env = made(8, SETTING_OFF, episode_steps=20)
    settings = {"n_steps": 32, "batch_size": 64, "n_epochs": 1, "normalize_advantage": False}
    spreads = Spreads()
    PPO("MlpPolicy", env, device="cpu", **settings).learn(
        1024, [CountApart(setting_off_of(env)), spreads]
    )
    assert len(spreads.found) == 4
    np.testing.assert_allclose(spreads.found, 1.0, rtol=1e-4)


def test_what_it_cannot_pay_in_is_refused():
    with pytest.raises(TypeError, match=r"must be a VecMonitor around an agents\.Sb3VecEnv"):
        SettingOff(VecMonitor(DummyVecEnv([lambda: gym.make("RimlessWheel-v0")])), 5)
    with pytest.raises(ValueError, match="intervals = 2000: must be less than the 2000 intervals"):
        Offer(setting_off=2000)
    with pytest.raises(ValueError, match="intervals = 300: must be less than the 200 intervals"):
        Offer(setting_off=300, episode_steps=200)
    with pytest.raises(ValueError, match="intervals = -1"):
        Offer(setting_off=-1)
