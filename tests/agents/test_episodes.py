"""Episodes of many rows are those of the single environment."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from agents.conditions import Conditions
from agents.policy_files import BASELINES, named_policy
from agents.rollout import episodes
from rimless_gym import BUILDABLE, PROTOTYPE


def refused(params):
    raise AssertionError("no gait is needed")


@pytest.mark.parametrize("name", ["random", "evolution"])
def test_the_single_environment_repeats_every_episode_bit_for_bit(name):
    policy = walker_or_baseline(name, refused).policy
    envs = Conditions(BUILDABLE).envs(4, max_episode_steps=150)
    alone = gym.make("RimlessWheel-v0", max_episode_steps=150)
    walked = episodes(envs, policy, 7, keep=("distance", "mode"))
    assert [one.seed for one in walked] == [7, 8, 9, 10]
    for one in walked:
        observation, info = alone.reset(seed=one.seed)
        np.testing.assert_array_equal(observation, one.observations[0])
        infos = [info]
        for k, action in enumerate(one.actions):
            observation, reward, terminated, truncated, info = alone.step(action)
            np.testing.assert_array_equal(observation, one.observations[k + 1])
            assert reward == one.rewards[k]
            assert (terminated, truncated) == (one.terminations[k], one.truncations[k])
            infos.append(info)
        assert terminated or truncated
        for entry, values in one.infos.items():
            np.testing.assert_array_equal(values, [info[entry] for info in infos])


def test_rows_end_by_themselves():
    envs = Conditions(BUILDABLE).envs(12, max_episode_steps=300)
    walked = episodes(envs, BASELINES["random"](0))
    lengths = {len(one.rewards) for one in walked}
    assert len(lengths) > 2
    for one in walked:
        assert not (one.terminations | one.truncations)[:-1].any()
        assert one.terminations[-1] == (len(one.rewards) < 300)
        assert one.total == one.rewards.sum()


def test_random_voltages_follow_the_seed():
    states = np.zeros((4, 5))
    first, again, other = (
        walker_or_baseline("random", refused, seed=seed).policy(states, states)
        for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first, other).any()


def test_a_baseline_walks_on_the_machine_that_is_given():
    idle = walker_or_baseline("idle", refused, PROTOTYPE)
    assert idle.params == PROTOTYPE
    (one,) = episodes(idle.conditions.envs(1, max_episode_steps=20), idle.policy)
    assert not one.actions.any()
