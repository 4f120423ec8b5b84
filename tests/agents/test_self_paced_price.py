"""The price of distance that follows the policy, in stable-baselines3."""

import dataclasses
import math
import signal

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from agents import Sb3VecEnv, learners
from agents.conditions import Conditions
from agents.pacing import CleanWalking
from agents.sb3 import pacing
from agents.sb3.pacing import Pacing, SelfPacedPrice, clean_walking, probe_of
from agents.sb3.training_env import HeldActions, Offer
from agents.session import Session
from agents.train import train
from agents.training import Training
from rimless_gym import BUILDABLE, RimlessWheelVectorEnv, Task
from tests.agents.runs import BRIEF, STEPS, assert_same_policies, run, scalars, small
from tests.agents.sb3_rows import ID, native

EVERY = 16


@pytest.fixture
def walks(monkeypatch):
    """A list of what the policy is found to walk like, look after look; each look is noted."""
    looks = []

    def prepare(*found):
        rest = iter(found)

        def look(act, envs, intervals, seed=0):
            looks.append(intervals)
            return next(rest)

        monkeypatch.setattr(pacing, "clean_walking", look)
        return looks

    return prepare


def learned(price, envs=None, looks=3):
    """A training in two environments that looks at the policy so many times."""
    envs = envs or VecMonitor(Sb3VecEnv(native(2)))
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, seed=0)
    return model.learn(EVERY * (looks + 1), price)


def paid(envs):
    return envs.get_attr("task")[0]


def test_the_price_falls_with_the_policys_own_cost_once_enough_starts_walk(walks):
    looks = walks(
        CleanWalking(0.2, 0.4, 0.5), CleanWalking(0.3, 1.5, 0.5), CleanWalking(1.0, 2.0, 0.5)
    )
    prices = []

    class Noted(SelfPacedPrice):
        def _on_rollout_end(self):
            prices.append((self.price, paid(self.training_env).distance_weight))

    learned(Noted(first_price=9.0, every=EVERY))
    assert prices == [(9.0, 9.0), (9.0, 9.0), (3.0, 3.0), (3.0, 3.0)]
    assert looks == [800] * 3  # 8 s


def test_it_begins_anew_with_every_new_training_and_goes_on_with_an_old_one(walks):
    cheap = CleanWalking(1.0, 1.0, 0.5)
    walks(*[cheap] * 4)
    price = SelfPacedPrice(first_price=9.0, every=EVERY)
    model = learned(price, looks=1)
    assert price.price == 2.0
    model.learn(EVERY, price, reset_num_timesteps=False)
    assert price.price == 2.0
    learned(price, looks=0)
    assert price.price == 9.0


def test_after_a_stop_the_task_is_still_that_of_the_environments(walks):
    walks(*[CleanWalking(1.0, 0.1, 0.5)] * 2)
    envs = VecMonitor(Sb3VecEnv(native(2)))
    own = paid(envs)

    class Stopped(SelfPacedPrice):
        def _on_step(self):
            if self.num_timesteps > EVERY and not stopped:
                stopped.append(True)
                raise KeyboardInterrupt
            return True

    stopped = []
    price = Stopped(first_price=9.0, every=EVERY)
    with pytest.raises(KeyboardInterrupt):
        learned(price, envs)
    assert paid(envs) != own
    learned(price, envs, looks=1)
    assert paid(envs) == own


def test_the_share_that_must_walk_before_the_price_falls_can_be_chosen(walks):
    walks(CleanWalking(0.7, 1.0, 0.5), CleanWalking(0.8, 1.5, 0.5))
    prices = []

    class Noted(SelfPacedPrice):
        def _on_rollout_end(self):
            prices.append(self.price)

    learned(Noted(first_price=9.0, every=EVERY, least_share=0.8), looks=2)
    assert prices == [9.0, 9.0, 3.0]


def test_the_price_keeps_within_a_margin_of_the_policys_own_cost(walks):
    walks(CleanWalking(1.0, 4.0, 0.5), CleanWalking(1.0, 0.8, 0.5))
    prices = []

    class Noted(SelfPacedPrice):
        def _on_rollout_end(self):
            prices.append(self.price)

    learned(Noted(first_price=9.0, every=EVERY, margin=1.0), looks=2)
    assert prices == [9.0, 5.0, 1.6]
    with pytest.raises(ValueError, match="margin = 0"):
        SelfPacedPrice(margin=0.0)


def test_the_price_is_never_below_the_true_one(walks):
    walks(CleanWalking(1.0, 0.05, 0.5))
    price = SelfPacedPrice(first_price=2.0, every=EVERY)
    learned(price, looks=1)
    assert price.price == Task().distance_weight
    walks(CleanWalking(0.0, math.inf, 0.0))
    price = SelfPacedPrice(first_price=0.1, every=EVERY)
    learned(price, looks=1)
    assert price.price == Task().distance_weight


@pytest.mark.parametrize("kind", [Sb3VecEnv, DummyVecEnv])
def test_it_works_through_wrappers_and_leaves_the_true_task_behind(walks, kind):
    walks(CleanWalking(1.0, 1.0, 0.5))
    seen = []

    class Noted(SelfPacedPrice):
        def _on_rollout_end(self):
            seen.append(paid(self.training_env))

    envs = VecNormalize(make_vec_env(ID, 2, 0, vec_env_cls=kind))
    learned(Noted(Pacing(first_price=5.0, every=EVERY)), envs, looks=1)
    assert [task.distance_weight for task in seen] == [5.0, 2.0]
    assert {(task.target_speed, task.fall_penalty, task.slip_penalty) for task in seen} == {
        (0.6, 0.5, 1.0)
    }
    assert paid(envs) == Task()


def test_it_charges_as_told_and_pays_no_more_speed_than_the_task(walks):
    walks()
    seen = []

    class Noted(SelfPacedPrice):
        def _on_rollout_end(self):
            seen.append(paid(self.training_env))

    task = Task(fall_penalty=0.2, slip_penalty=0.1, target_speed=0.3)
    learned(Noted(), VecMonitor(Sb3VecEnv(native(2, task=task))), looks=0)
    charged = {"fall_penalty": 0.5, "slip_penalty": 1.0}
    assert seen == [dataclasses.replace(task, distance_weight=20.0, **charged)]


def test_settings_are_those_of_pacing_and_are_checked():
    assert SelfPacedPrice(every=3).pacing == Pacing(every=3)
    with pytest.raises(ValueError, match="paid_speed"):
        SelfPacedPrice(paid_speed=0.0)
    with pytest.raises(ValueError, match=r"multiple = 1: .*give more than 1; 2 is usual"):
        SelfPacedPrice(multiple=1.0)
    with pytest.raises(TypeError, match="evry"):
        SelfPacedPrice(evry=3)
    with pytest.raises(TypeError, match="give one of them"):
        SelfPacedPrice(Pacing(), every=3)


def test_a_constant_voltage_walks_dearly_and_rest_does_not_walk():
    envs = probe_of(Sb3VecEnv(native(1)), 16)

    def act(voltage):
        return lambda seen: np.full((len(seen), 1), voltage, dtype=np.float32)

    rolls, rests = (clean_walking(act(voltage), envs, 800) for voltage in (0.6, 0.0))
    assert 0.3 < rolls.share < 1.0
    assert (rolls.cot, rolls.speed) == (pytest.approx(1.0, abs=0.1), pytest.approx(0.77, abs=0.1))
    assert rests == CleanWalking(0.0, math.inf, 0.0)
    assert clean_walking(act(0.6), envs, 800) == rolls  # the same starts again


def test_it_looks_at_a_commanded_speed_too():
    speed = gym.make_vec("RimlessWheelSpeed-v0", num_envs=1, autoreset_mode="SameStep")
    envs = probe_of(Sb3VecEnv(speed), 3)
    assert envs.observation_space.shape == (3, 8)
    assert (envs.control, envs.max_episode_steps) == (speed.control, None)


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_a_training_that_was_stopped_goes_on_with_its_price(tmp_path, monkeypatch, algo):
    def look(act, *rest):  # some cost that depends on the policy
        return CleanWalking(1.0, 1.5 + 0.5 * float(act(np.ones((1, 6), np.float32))[0, 0]), 0.5)

    monkeypatch.setattr(pacing, "clean_walking", look)
    settings = small(algo)
    paced = dataclasses.replace(settings.pacing, every=STEPS[algo] // 8)
    settings = dataclasses.replace(settings, pacing=paced)
    whole = run(tmp_path / "whole", algo, settings=settings)
    between, seen = Session.between, []

    def ask(self):
        seen.append(len(seen))
        if len(seen) > 3 * STEPS[algo] // 4 // {"ppo": 128, "sac": 16}[algo]:
            signal.raise_signal(signal.SIGINT)
        between(self)

    monkeypatch.setattr(Session, "between", ask)
    assert run(tmp_path / "broken", algo, settings=settings).interrupted
    monkeypatch.setattr(Session, "between", between)
    resumed = run(tmp_path / "broken", algo, settings=settings)
    assert_same_policies(resumed, whole)
    prices = [
        [event.value for event in scalars(tmp_path / name)["pacing/price"]]
        for name in ("whole", "broken")
    ]
    assert prices[0] == prices[1]
    assert prices[0][-1] < paced.first_price


def test_hyperparameters_that_cannot_walk_are_warned_of_with_their_numbers(tmp_path):
    settings = small("ppo")
    blind = dataclasses.replace(
        settings, offer=Offer(), algorithm=settings.algorithm | {"gamma": 0.9}
    )
    with pytest.warns(UserWarning, match=r"gamma = 0.9: .* 10 ms .* 0.1 s .*lasts 0\.\d+ s"):
        train("ppo", out=tmp_path / "a", settings=blind, timesteps=0, protocol=BRIEF)
    cheap = dataclasses.replace(settings, pacing=None)
    with pytest.warns(UserWarning, match=r"distance_weight = 0.5 from scratch: .* about 1 "):
        train("ppo", out=tmp_path / "b", settings=cheap, timesteps=0, protocol=BRIEF)
    slow = dataclasses.replace(settings, offer=Offer({HeldActions: {"intervals": 50}}))
    with pytest.warns(UserWarning, match=r"held for 0.5 s, and a step .* lasts 0\.\d+ s"):
        train("ppo", out=tmp_path / "c", settings=slow, timesteps=0, protocol=BRIEF)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.parametrize("init", ["scratch", "a policy"])
def test_published_hyperparameters_give_no_warning(algo, init):
    kind = learners.learner(algo)
    training = Training(algo, init, 0, Conditions(BUILDABLE), Task(), kind.settings(init))
    assert kind.advice(training) == []


def test_prices_change_in_some_rows_while_their_episodes_go_on():
    envs, alike = (RimlessWheelVectorEnv(2) for _ in range(2))
    for each in (envs, alike):
        each.reset(seed=0)
    envs.set_task({"distance_weight": 5.0}, np.array([False, True]))
    assert [task.distance_weight for task in envs.tasks] == [0.5, 5.0]
    ours, theirs = (each.step(np.full((2, 1), 0.5, np.float32)) for each in (envs, alike))
    np.testing.assert_array_equal(ours[0], theirs[0])
    assert ours[1][0] == theirs[1][0]
    distance = ours[4]["reward_distance"], theirs[4]["reward_distance"]
    assert distance[0][1] == pytest.approx(10 * distance[1][1])
    single = gym.make(ID)
    single.unwrapped.set_task(Task(3.0))
    assert single.unwrapped.task == Task(3.0)
    with pytest.raises(TypeError, match="give a rimless_gym"):
        single.unwrapped.set_task(3.0)
