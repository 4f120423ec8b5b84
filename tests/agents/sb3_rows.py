"""Sb3VecEnv beside stable-baselines3's own DummyVecEnv, for the tests beside this file."""

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv

from agents import Sb3VecEnv

ID = "RimlessWheel-v0"
REST = {"mode": "double_stance"}


def native(n, **settings):
    settings = {"autoreset_mode": AutoresetMode.SAME_STEP} | settings
    return gym.make_vec(ID, num_envs=n, **settings)


def both(n, seed=0, **settings):
    """Our Sb3VecEnv and a DummyVecEnv, made and seeded alike, not yet reset."""
    return [
        make_vec_env(ID, n, seed, vec_env_cls=kind, **settings) for kind in (Sb3VecEnv, DummyVecEnv)
    ]


def whirling(n, k):
    """Full voltage that changes sign slowly, so that wheels soon fall; shape (n, 1)."""
    return np.sign(np.sin(k / 20 + np.arange(n)))[:, None].astype(np.float32)


def assert_same(info, other):
    """The same entries with the same values; wall-clock times aside."""
    info, other = dict(info), dict(other)
    ends = [each.pop("terminal_observation", None) for each in (info, other)]
    assert (ends[0] is None) == (ends[1] is None)
    if ends[0] is not None:
        np.testing.assert_array_equal(*ends)
    for each in (info, other):
        if "episode" in each:
            each["episode"] = each["episode"] | {"t": 0.0}
    assert info == other
    assert {name: type(value) for name, value in info.items()} == {
        name: type(value) for name, value in other.items()
    }
