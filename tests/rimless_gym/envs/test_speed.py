"""The environment with a commanded speed, single and in rows."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from rimless_gym import (
    BUILDABLE,
    RimlessWheelEnv,
    RimlessWheelSpeedEnv,
)
from rimless_gym.envs.task import rewarded
from tests.rimless_gym.envs.rows import DISABLED, ID, NEXT, SAME, SPEED_ID, STILL, make, swinging


def rows(n: int, mode: Any = NEXT, **settings: Any) -> Any:
    return make(n, mode, SPEED_ID, **settings)


def test_the_first_six_observations_are_those_of_the_plain_environment() -> None:
    env, plain = gym.make(SPEED_ID), gym.make(ID, control_period=0.04)
    assert np.array_equal(env.reset(seed=4)[0][:6], plain.reset(seed=4)[0])
    for action in swinging(1, 200, hold=5)[:, 0]:
        seen, _, ended, _, info = env.step(action)
        expected, _, falls, _, other = plain.step(action)
        assert np.array_equal(seen[:6], expected)
        assert (ended, info["distance"]) == (falls, other["distance"])
        if ended:
            break


def test_command_and_allowance_are_observed_and_rewarded() -> None:
    env: RimlessWheelSpeedEnv = gym.make(SPEED_ID).unwrapped  # type: ignore[assignment]
    seen, _ = env.reset(seed=0, options={"speed": 0.55})
    step, allowance = BUILDABLE.step_length, BUILDABLE.step_length
    assert env.command == 0.55
    for action in swinging(1, 100, hold=5)[:, 0]:
        assert seen[6] == pytest.approx((0.55 - 0.45) / 0.2, rel=1e-6)
        assert seen[7] == pytest.approx(allowance / step, rel=1e-6)
        seen, _, ended, _, _ = env.step(action)
        info = env.measurements
        travel, allowance = rewarded(info["distance"], info["elapsed"], allowance, step, 0.55)
        assert info["reward_distance"] == 5.0 * travel == 5.0 * info["rewarded_travel"]
        if ended:
            seen, _ = env.reset(options={"speed": 0.55})
            allowance = step
    assert env.observation_space.contains(seen)


def test_commands_are_drawn_uniformly_from_their_range() -> None:
    envs = rows(2000, speeds=(0.4, 0.8))
    envs.reset(seed=0)
    first = envs.commands
    assert first.min() >= 0.4
    assert first.max() < 0.8
    assert first.mean() == pytest.approx(0.6, abs=0.01)
    envs.reset()
    assert (envs.commands != first).all()


def test_commands_changed_within_episodes_change_rows_and_single_environments_alike() -> None:
    n, mask = 6, np.arange(6) % 2 == 0
    envs = rows(n, SAME, max_episode_steps=30)
    singles = [gym.make(SPEED_ID, max_episode_steps=30) for _ in range(n)]
    envs.reset(seed=11)
    for i, one in enumerate(singles):
        one.reset(seed=11 + i)
    for k, actions in enumerate(swinging(n, 80, hold=5)):
        if k == 20:
            envs.set_command(0.7, mask)
            for i in np.flatnonzero(mask):
                singles[i].unwrapped.set_command(0.7)
        seen, rewards, ended, truncated, _ = envs.step(actions)
        for i, one in enumerate(singles):
            expected, reward, *over, _ = one.step(actions[i])
            assert [rewards[i], ended[i], truncated[i]] == [reward, *over]
            expected = one.reset()[0] if any(over) else expected
            assert np.array_equal(seen[i], expected)
            assert envs.commands[i] == one.unwrapped.command


def test_a_change_of_command_is_observed_next_and_ends_with_the_episode() -> None:
    env = RimlessWheelSpeedEnv()
    env.reset(seed=0, options={"mode": "double_stance", "speed": 0.3})
    env.set_command(0.6)
    assert env.command == 0.6
    seen, *_ = env.step(STILL)
    assert seen[6] == pytest.approx(0.75)
    env.reset()
    assert env.command != 0.6  # the next episode draws another


def test_rows_that_are_not_reset_keep_their_commands() -> None:
    envs, mask = rows(4, DISABLED), np.array([True, False, False, True])
    envs.reset(seed=0, options={"speed": [0.3, 0.4, 0.5, 0.6]})
    assert envs.commands.tolist() == [0.3, 0.4, 0.5, 0.6]
    envs.reset(options={"reset_mask": mask, "speed": 0.35, "task": {"slip_penalty": 3.0}})
    assert envs.commands.tolist() == [0.35, 0.4, 0.5, 0.35]
    assert [task.slip_penalty for task in envs.tasks] == [3.0, 1.0, 1.0, 3.0]
    envs.reset(options={"reset_mask": mask, "params": {"slope": 0.01}})
    assert envs.commands[1:3].tolist() == [0.4, 0.5]


def test_snapshots_pickles_and_specs_keep_the_command() -> None:
    env: Any = gym.make(SPEED_ID, speeds=(0.5, 0.6))
    env.reset(seed=0)
    env.unwrapped.set_command(0.45)
    env.step(STILL)
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    again: Any = gym.make(EnvSpec.from_json(env.spec.to_json()))
    again.unwrapped.set_state(env.unwrapped.get_state())
    for twin in (*twins, again):
        assert twin.unwrapped.command == 0.45
        other = copy.deepcopy(env)
        for _ in range(3):
            ahead, behind = (each.unwrapped.step(STILL) for each in (other, twin))
            assert np.array_equal(ahead[0], behind[0])
        assert np.array_equal(other.reset()[0], twin.reset()[0])
    with pytest.raises(ValueError, match=r"speeds=\(0.5, 0.6\).*, not of Control"):
        RimlessWheelSpeedEnv().set_state(env.unwrapped.get_state())
    with pytest.raises(ValueError, match="not of Control"):
        RimlessWheelEnv(control_period=0.04).set_state(env.unwrapped.get_state())


def test_resting_is_not_rewarded() -> None:
    env = gym.make(SPEED_ID)
    env.reset(options={"mode": "double_stance", "speed": 0.4})
    total, truncated = 0.0, False
    while not truncated:
        _, reward, _, truncated, _ = env.step(STILL)
        total += reward
    assert total == pytest.approx(-20 * BUILDABLE.idle_power / BUILDABLE.weight)


def test_a_change_of_weights_within_an_episode_leaves_the_command_as_it_is() -> None:
    env, envs = RimlessWheelSpeedEnv(), rows(2)
    for one in (env, envs):
        one.reset(seed=0, options={"speed": 0.41})
        one.set_task({"slip_penalty": 3.0})
    assert env.command == 0.41
    assert envs.commands.tolist() == [0.41, 0.41]
    changed, same = RimlessWheelSpeedEnv(), RimlessWheelSpeedEnv()
    for one in (changed, same):
        one.reset(seed=3)
    changed.set_task({"distance_weight": 1.0})
    assert np.array_equal(changed.step(STILL)[0], same.step(STILL)[0])
