"""stable-baselines3's monitors, normalisation and checkers around Sb3VecEnv."""

import json

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecCheckNan, VecMonitor, VecNormalize

from agents import Sb3VecEnv
from tests.agents.sb3_rows import ID, assert_same, both, native, whirling


def test_vec_monitor_reports_the_same_episodes_as_single_monitors(tmp_path):
    limit = {"max_episode_steps": 50}
    ours = VecMonitor(Sb3VecEnv(native(3, **limit)), str(tmp_path), info_keywords=("distance",))
    theirs = make_vec_env(ID, 3, env_kwargs=limit, monitor_kwargs={"info_keywords": ("distance",)})
    for env in (ours, theirs):
        env.seed(2)
        env.reset()
    seen = 0
    for k in range(160):
        one, other = ours.step(whirling(3, k))[3], theirs.step(whirling(3, k))[3]
        for mine, yours in zip(one, other, strict=True):
            assert ("episode" in mine) == ("episode" in yours)
            if "episode" in mine:
                seen += 1
                assert mine["episode"]["r"] == pytest.approx(yours["episode"]["r"], abs=1e-5)
                assert mine["episode"]["l"] == yours["episode"]["l"]
                assert mine["episode"]["distance"] == yours["episode"]["distance"]
    ours.close()
    header, names, *episodes = (tmp_path / "monitor.csv").read_text().splitlines()
    assert json.loads(header[1:])["env_id"] == ID
    assert names == "r,l,t,distance"
    assert len(episodes) == seen >= 9


def test_monitors_of_single_environments_write_their_files(tmp_path):
    env = make_vec_env(
        ID,
        3,
        0,
        monitor_dir=str(tmp_path),
        vec_env_cls=Sb3VecEnv,
        env_kwargs={"max_episode_steps": 20},
    )
    env.reset()
    for k in range(45):
        env.step(whirling(3, k))
    assert env.env_is_wrapped(Monitor) == [True] * 3
    lengths = env.env_method("get_episode_lengths")
    rewards = env.env_method("get_episode_rewards", indices=[1])
    env.close()
    for i in range(3):
        rows = (tmp_path / f"{i}.monitor.csv").read_text().splitlines()[2:]
        assert [int(row.split(",")[1]) for row in rows] == lengths[i]
        assert 45 - 20 < sum(lengths[i]) <= 45  # the last episode is not over
        assert max(lengths[i]) <= 20
    assert len(rewards[0]) == len(lengths[1])


def test_vec_normalize_gives_the_same_numbers_and_can_be_saved_and_loaded(tmp_path):
    ours, theirs = (VecNormalize(env) for env in both(3, env_kwargs={"max_episode_steps": 40}))
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(100):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
    ours.save(tmp_path / "normalize.pkl")
    loaded = VecNormalize.load(tmp_path / "normalize.pkl", Sb3VecEnv(native(3)))
    raw = ours.get_original_obs()
    np.testing.assert_array_equal(loaded.normalize_obs(raw), ours.normalize_obs(raw))


def test_the_checkers_of_stable_baselines3_pass_without_warnings(recwarn):
    check_env(gym.make(ID))
    env = VecCheckNan(Sb3VecEnv(native(2)), raise_exception=True)
    env.reset()
    for k in range(20):
        env.step(whirling(2, k))
    assert not recwarn.list
