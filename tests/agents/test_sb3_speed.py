"""The environment with a commanded speed under stable-baselines3."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv

from agents import Sb3VecEnv
from tests.agents.sb3_rows import assert_same, whirling

ID = "RimlessWheelSpeed-v0"


def both(n, **settings):
    return [
        make_vec_env(ID, n, 3, vec_env_cls=kind, env_kwargs=settings)
        for kind in (Sb3VecEnv, DummyVecEnv)
    ]


@pytest.mark.parametrize(
    "settings",
    [{}, {"speeds": (0.5, 0.7), "control_period": 0.1, "starts": {"whirling": 1.0}}],
    ids=["plain", "other arguments"],
)
def test_rows_equal_single_environments_bit_for_bit(settings):
    ours, theirs = both(4, **settings)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    ends = set()
    for k in range(600):
        actions = 0.3 * whirling(4, k)
        one, other = ours.step(actions), theirs.step(actions)
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
            if "episode" in mine:
                ends.add("time" if mine["TimeLimit.truncated"] else "fall")
    assert ends
    assert ours.get_attr("command") == theirs.get_attr("command")
    assert ours.get_attr("task") == theirs.get_attr("task")


def test_default_ppo_learns_the_same_weights_as_in_single_environments():
    learned = []
    for env in both(4):
        model = PPO("MlpPolicy", env, seed=1, device="cpu", n_steps=64)
        model.learn(256)
        learned.append(torch.cat([p.detach().ravel() for p in model.policy.parameters()]))
    assert torch.equal(*learned)


def test_the_native_environment_is_accepted_and_takes_commands():
    native = gym.make_vec(ID, num_envs=3, autoreset_mode=AutoresetMode.SAME_STEP)
    env = Sb3VecEnv(native)
    env.set_options({"speed": 0.4})
    assert env.reset()[:, 6] == pytest.approx(np.full(3, -0.25), abs=1e-6)
    native.set_command(0.6, np.array([False, True, False]))
    seen = env.step(np.zeros((3, 1), np.float32))[0]
    assert seen[:, 6] == pytest.approx([-0.25, 0.75, -0.25], abs=1e-6)


def test_environments_of_different_kinds_are_refused():
    for first, second in ((ID, "RimlessWheel-v0"), ("RimlessWheel-v0", ID)):
        with pytest.raises(ValueError, match=r"environment 1 has native = .*use DummyVecEnv"):
            Sb3VecEnv([lambda: gym.make(first), lambda: gym.make(second)])  # noqa: B023
