"""Sb3VecEnv gives what stable-baselines3's own DummyVecEnv of single environments gives."""

from inspect import signature

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv

from agents import Sb3VecEnv
from rimless_gym import PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL, Task
from rimless_gym.envs.disturbances import Disturbances, Pushes, SensorNoise
from rimless_gym.envs.env import RimlessWheelEnv
from tests.agents.sb3_rows import ID, assert_same, both, whirling


@pytest.mark.parametrize("n", [1, 5])
@pytest.mark.parametrize("limit", [40, 2000])
def test_rows_equal_single_environments_bit_for_bit_over_many_episodes(n, limit):
    task, machine = Task(distance_weight=0.8), THESIS_PHYSICAL.replace(hub_damping=0.1)
    ours, theirs = both(
        n,
        seed=7,
        env_kwargs={"params": machine, "task": task, "max_episode_steps": limit},
        monitor_kwargs={"info_keywords": ("distance", "failure")},
    )
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    assert ours.reset_infos == theirs.reset_infos
    ends = set()
    for k in range(400):
        one, other = ours.step(whirling(n, k)), theirs.step(whirling(n, k))
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
            assert mine.dtype == yours.dtype
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
            if "episode" in mine:
                ends.add("time" if mine["TimeLimit.truncated"] else "fall")
        assert ours.reset_infos == theirs.reset_infos
    assert ("time" if limit == 40 else "fall") in ends


def test_rows_of_different_machines_equal_single_environments():
    machines = (THESIS_NOMINAL, THESIS_PHYSICAL, PROTOTYPE)
    makers = [lambda params=params: gym.make(ID, params=params) for params in machines]
    ours, theirs = Sb3VecEnv(makers), DummyVecEnv(makers)
    for env in (ours, theirs):
        env.seed(3)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(100):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
    assert ours.get_attr("params") == list(machines)


def test_randomised_and_disturbed_rows_equal_single_environments():
    settings = {
        "ranges": {"pendulum_mass": (2.0, 2.4), "slope": (-0.02, 0.02)},
        "disturbances": Disturbances(
            pushes=Pushes(rate=5.0, impulse=(0.0, 0.1)), sensor_noise=SensorNoise(leg_angle=0.01)
        ),
        "control_period": 0.02,
        "actions": "current",
        "starts": {"whirling": 1.0},
    }
    handed_on = {"params", "task", "render_mode", *settings}
    assert set(signature(RimlessWheelEnv).parameters) == handed_on
    ours, theirs = both(3, seed=4, env_kwargs=settings)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(200):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
    assert len({machine.pendulum_mass for machine in ours.get_attr("params")}) == 3


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_a_policy_learns_the_same_weights_as_in_single_environments(algorithm):
    settings = {PPO: {"n_steps": 64, "batch_size": 64}, SAC: {"learning_starts": 50}}[algorithm]
    learned = []
    for env in both(4, seed=1, env_kwargs={"max_episode_steps": 15}):
        model = algorithm("MlpPolicy", env, seed=1, device="cpu", **settings)
        model.learn(512 if algorithm is PPO else 160)
        assert model.ep_info_buffer
        learned.append(torch.cat([p.detach().ravel() for p in model.policy.parameters()]))
    assert torch.equal(*learned)


def test_evaluate_policy_finds_the_same_returns():
    found = []
    for env in both(3, seed=9, env_kwargs={"max_episode_steps": 60}):
        model = PPO("MlpPolicy", env, seed=0, device="cpu", n_steps=8, batch_size=8)
        env.seed(9)
        found.append(evaluate_policy(model, env, 7, return_episode_rewards=True))
    assert found[0] == found[1]
    assert len(found[0][0]) == 7


def test_pictures_are_those_of_the_single_environments():
    ours, theirs = both(3, env_kwargs={"render_mode": "rgb_array"})
    for env in (ours, theirs):
        env.reset()
        env.step(whirling(3, 0))
    for mine, yours in zip(ours.get_images(), theirs.get_images(), strict=True):
        np.testing.assert_array_equal(mine, yours)
    np.testing.assert_array_equal(ours.render(), theirs.render())
    with pytest.raises(ValueError, match=r"render_mode = 'human': .*'rgb_array'"):
        both(1, env_kwargs={"render_mode": "human"})
