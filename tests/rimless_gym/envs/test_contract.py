"""Gymnasium's contract of the single environment: observations, actions, ends, pictures."""

from __future__ import annotations

import math
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from rimless_gym import THESIS_PHYSICAL, RimlessWheelVectorEnv
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.hybrid import Failure


def test_both_checkers_are_silent() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make("RimlessWheel-v0", render_mode="rgb_array").unwrapped)
        sb3_check_env(gym.make("RimlessWheel-v0"))
        checked = gym.make("RimlessWheel-v0", disable_env_checker=False)
        checked.reset(seed=0)
        checked.step(np.zeros(1, np.float32))


def test_the_environment_itself_enforces_the_order_of_calls() -> None:
    env = gym.make("RimlessWheel-v0", render_mode="rgb_array")
    with pytest.raises(RuntimeError, match=r"no episode is running: call reset\(\) first"):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(RuntimeError, match=r"no episode has begun: call reset\(\) first"):
        env.render()
    env.reset(seed=0)
    env.step(np.zeros(1, np.float32))


def test_no_observation_element_is_constant_and_all_stay_in_bounds(env: gym.Env) -> None:
    rng, seen = np.random.default_rng(2), []
    env.reset(seed=2)
    for _ in range(3000):
        observation, _, ended, truncated, _ = env.step(rng.uniform(-1, 1, 1).astype(np.float32))
        assert env.observation_space.contains(observation)
        seen.append(observation)
        if ended or truncated:
            seen.append(env.reset()[0])
    assert np.all(np.ptp(seen, axis=0) > 0.1)
    assert len({id(observation) for observation in seen}) == len(seen)


def test_losing_contact_terminates_within_the_step_and_says_so(env: gym.Env) -> None:
    env.reset(options={"state": [1.5, 1.5, 1.0, -14.0]})
    for _ in range(300):
        _, _, terminated, truncated, info = env.step(np.array([-1.0], np.float32))
        if terminated:
            break
    assert terminated
    assert not truncated
    assert Failure(info["failure"]) in (Failure.CONTACT_LOST, Failure.RATE_EXCEEDED)
    assert info["elapsed"] <= 0.01
    with pytest.raises(RuntimeError, match="reset"):
        env.unwrapped.step(np.zeros(1, np.float32))


def test_actions_are_clipped_but_nan_and_wrong_shapes_raise() -> None:
    first, second = RimlessWheelEnv(), RimlessWheelEnv()
    for each in (first, second):
        each.reset(seed=0)
    over, _, _, _, _ = first.step(np.array([7.0], np.float32))
    limit, _, _, _, _ = second.step(np.array([1.0], np.float32))
    assert np.array_equal(over, limit)
    with pytest.raises(ValueError, match="NaN"):
        first.step(np.array([math.nan], np.float32))
    for action in (np.zeros(2, np.float32), np.zeros((1, 1), np.float32)):
        with pytest.raises(ValueError, match="shape"):
            first.step(action)
    assert np.array_equal(first.state, second.state)  # a refused action changes nothing


@pytest.mark.parametrize(
    ("action", "error"),
    [
        (None, TypeError),
        ("full speed", TypeError),
        (np.array(["0.5"]), TypeError),
        (np.array([None]), TypeError),
        (np.array([{}]), TypeError),
        (np.array([10**400]), TypeError),
        (np.array([0.5 + 0j]), TypeError),
        (np.array([1], "datetime64[s]"), TypeError),
        ([[0.5], [0.1, 0.2]], ValueError),
        ([], ValueError),
        ([math.nan], ValueError),
        (np.array([math.nan], np.float16), ValueError),
    ],
)
def test_invalid_actions_are_refused_and_change_nothing(action: Any, error: type) -> None:
    env = RimlessWheelEnv()
    env.reset(seed=0)
    before = env.get_state()["batch"]["memory"]
    with pytest.raises(error, match=r"(?s)action = .*: must "):
        env.step(action)
    assert np.array_equal(env.get_state()["batch"]["memory"], before)


@pytest.mark.parametrize(
    "one",
    [[1], [True], np.array([1]), np.array([True]), (np.float32(1),), np.ones(1, np.longdouble)],
    ids=repr,
)
def test_actions_may_be_real_numbers_of_any_type(one: Any) -> None:
    first, second, third = RimlessWheelEnv(), RimlessWheelEnv(), RimlessWheelEnv()
    for each in (first, second, third):
        each.reset(seed=0)
    expected = second.step(np.ones(1, np.float32))
    assert np.array_equal(first.step(one)[0], expected[0])
    assert np.array_equal(third.step(one[0])[0], expected[0])
    many = RimlessWheelVectorEnv(2)
    many.reset(seed=0)
    assert np.array_equal(many.step([one, one])[0][0], expected[0])


@pytest.mark.parametrize("limit", [1e3, 3e4, 1e6])
def test_absurd_voltages_end_the_episode_or_raise_but_never_give_nonsense(limit: float) -> None:
    env = RimlessWheelEnv(THESIS_PHYSICAL.replace(voltage_limit=limit))
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(500):
        try:
            observation, reward, ended, _, info = env.step(rng.uniform(-1, 1, 1))
        except RuntimeError:  # the motion diverged
            env.reset()
            continue
        assert np.all(np.isfinite(observation))
        assert math.isfinite(reward)
        spent = info["copper"] + info["collision"] + info["mechanical_change"]
        assert abs(info["electrical"] - spent) < 1e-7 * max(1.0, abs(info["electrical"]))
        if ended:
            env.reset()


def test_stepping_before_reset_is_refused_with_the_remedy() -> None:
    with pytest.raises(RuntimeError, match="reset"):
        RimlessWheelEnv().step(np.zeros(1, np.float32))


def test_frames_are_drawn_without_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    env = gym.make("RimlessWheel-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(10):
        env.step(np.ones(1, np.float32))
    second = env.render()
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    assert not np.array_equal(first, second)
