"""The reward weight of distance that follows the policy, in stable-baselines3."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from agents import Sb3VecEnv
from agents.reward_weight import (
    LEAST_SHARE,
    MULTIPLE,
    NO_WALK,
    CleanWalking,
    adapted_weight,
)
from agents.sb3 import reward_weight
from agents.sb3.reward_weight import AdaptiveRewardWeight, clean_walking
from rimless_gym import Task

EVERY, COSTLY = 16, CleanWalking(1.0, 1.0, 0.5)


def test_the_weight_follows_the_cost_of_walking_and_never_rises():
    walk = CleanWalking(0.9, 0.8, 0.5)
    assert adapted_weight(5.0, walk, 0.5) == MULTIPLE * 0.8
    assert adapted_weight(1.0, walk, 0.5) == 1.0
    assert adapted_weight(1.0, CleanWalking(0.9, 0.05, 0.5), 0.5) == 0.5
    assert adapted_weight(5.0, CleanWalking(LEAST_SHARE - 0.01, 0.8, 0.5), 0.5) == 5.0
    assert adapted_weight(5.0, NO_WALK, 0.5) == 5.0
    assert adapted_weight(5.0, walk, 0.5, multiple=3.0) == 3.0 * 0.8
    assert adapted_weight(5.0, walk, 0.5, margin=0.1) == pytest.approx(0.9)


def native(n, **settings):
    return gym.make_vec("RimlessWheel-v0", num_envs=n, autoreset_mode="SameStep", **settings)


@pytest.fixture
def walks(monkeypatch):
    """Sets what the policy is found to walk like, check after check; collects their lengths."""
    checks = []

    def prepare(*walks):
        rest = iter(walks)

        def check(act, envs, intervals):
            checks.append(intervals)
            return next(rest)

        monkeypatch.setattr(reward_weight, "clean_walking", check)
        return checks

    return prepare


class Noted(AdaptiveRewardWeight):
    """Collects the tasks of the environments, roll-out after roll-out."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.tasks = []

    def _on_rollout_end(self):
        self.tasks.append(self.training_env.get_attr("task")[0])

    @property
    def weights(self):
        return [task.distance_weight for task in self.tasks]


def learned(adaptive, envs=None, checks=3):
    """A training in two environments that checks the policy so many times."""
    envs = envs or VecMonitor(Sb3VecEnv(native(2)))
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, seed=0)
    return model.learn(EVERY * (checks + 1), adaptive)


def test_it_falls_with_the_policys_own_cost_once_enough_starts_walk(walks):
    checks = walks(CleanWalking(0.2, 0.4, 0.5), CleanWalking(0.3, 1.5, 0.5), COSTLY._replace(cot=2))
    adaptive = Noted(first_weight=9.0, every=EVERY)
    learned(adaptive)
    assert adaptive.weights == [9.0, 9.0, 3.0, 3.0]
    assert checks == [800] * 3  # 8 s


def test_it_begins_anew_with_every_new_training_and_goes_on_with_an_old_one(walks):
    walks(*[COSTLY] * 4)
    adaptive = AdaptiveRewardWeight(first_weight=9.0, every=EVERY)
    model = learned(adaptive, checks=1)
    assert adaptive.weight == 2.0
    model.learn(EVERY, adaptive, reset_num_timesteps=False)
    assert adaptive.weight == 2.0
    learned(adaptive, checks=0)
    assert adaptive.weight == 9.0


def test_it_is_never_below_the_true_one(walks):
    walks(CleanWalking(1.0, 0.05, 0.5), NO_WALK)
    for first in (2.0, 0.1):
        adaptive = AdaptiveRewardWeight(first_weight=first, every=EVERY)
        learned(adaptive, checks=1)
        assert adaptive.weight == Task().distance_weight


@pytest.mark.parametrize("kind", [Sb3VecEnv, DummyVecEnv])
def test_it_works_through_wrappers_and_leaves_the_true_task_behind(walks, kind):
    walks(COSTLY)
    envs = VecNormalize(make_vec_env("RimlessWheel-v0", 2, 0, vec_env_cls=kind))
    adaptive = Noted(first_weight=5.0, every=EVERY)
    learned(adaptive, envs, checks=1)
    assert adaptive.weights == [5.0, 2.0]
    for task in adaptive.tasks:
        assert (task.target_speed, task.fall_penalty, task.slip_penalty) == (0.6, 0.5, 1.0)
    assert envs.get_attr("task")[0] == Task()


def test_a_constant_voltage_walks_at_a_high_cost_and_rest_does_not_walk():
    envs = reward_weight._probe_of(Sb3VecEnv(native(1)), 16)

    def act(voltage):
        return lambda seen: np.full((len(seen), 1), voltage, dtype=np.float32)

    rolls, rests = (clean_walking(act(voltage), envs, 800) for voltage in (0.6, 0.0))
    assert 0.3 < rolls.share < 1.0
    assert (rolls.cot, rolls.speed) == (pytest.approx(1.0, abs=0.1), pytest.approx(0.77, abs=0.1))
    assert rests == NO_WALK
    assert clean_walking(act(0.6), envs, 800) == rolls  # the same starts again


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"evry": 3}, TypeError, "evry"),
        ({"every": 0}, ValueError, "every = 0"),
    ],
)
def test_settings_that_cannot_work_are_refused(settings, error, message):
    with pytest.raises(error, match=message):
        AdaptiveRewardWeight(**settings)
