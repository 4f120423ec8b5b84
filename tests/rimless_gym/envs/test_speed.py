"""The environment with a commanded speed, single and in rows."""

from __future__ import annotations

import copy
import math
import pickle
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from rimless_gym import (
    BUILDABLE,
    RimlessWheelEnv,
    RimlessWheelSpeedEnv,
    RimlessWheelSpeedVectorEnv,
    Task,
)
from rimless_gym.envs.task import rewarded
from tests.rimless_gym.envs.rows import DISABLED, NEXT, ROUGH, SAME, swinging

ID = "RimlessWheelSpeed-v0"
STILL = np.zeros(1, np.float32)


def make(n: int, mode: Any = NEXT, **settings: Any) -> RimlessWheelSpeedVectorEnv:
    envs = gym.make_vec(ID, num_envs=n, autoreset_mode=mode, **settings)
    assert isinstance(envs, RimlessWheelSpeedVectorEnv)
    return envs


def test_both_checkers_are_silent() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(ID, render_mode="rgb_array").unwrapped)
        sb3_check_env(gym.make(ID))


def test_the_first_six_observations_are_those_of_the_plain_environment() -> None:
    env, plain = gym.make(ID), gym.make("RimlessWheel-v0", control_period=0.04)
    assert np.array_equal(env.reset(seed=4)[0][:6], plain.reset(seed=4)[0])
    for action in swinging(1, 200, hold=5)[:, 0]:
        seen, _, ended, _, info = env.step(action)
        expected, _, falls, _, other = plain.step(action)
        assert np.array_equal(seen[:6], expected)
        assert (ended, info["distance"]) == (falls, other["distance"])
        if ended:
            break


def test_command_and_credit_are_observed_and_paid_for() -> None:
    env = gym.make(ID)
    seen, _ = env.reset(seed=0, options={"speed": 0.55})
    step, credit = BUILDABLE.step_length, BUILDABLE.step_length
    assert env.unwrapped.command == 0.55
    for action in swinging(1, 100, hold=5)[:, 0]:
        assert seen[6] == pytest.approx((0.55 - 0.45) / 0.2, rel=1e-6)
        assert seen[7] == pytest.approx(credit / step, rel=1e-6)
        seen, _, ended, _, info = env.step(action)
        paid, credit = rewarded(info["distance"], info["elapsed"], credit, step, 0.55)
        assert info["reward_distance"] == 5.0 * paid == 5.0 * info["rewarded_travel"]
        if ended:
            seen, _ = env.reset(options={"speed": 0.55})
            credit = step
    assert env.observation_space.contains(seen)


def test_commands_are_drawn_uniformly_from_their_range() -> None:
    envs = make(2000, speeds=(0.4, 0.8))
    envs.reset(seed=0)
    first = envs.commands
    assert first.min() >= 0.4
    assert first.max() < 0.8
    assert first.mean() == pytest.approx(0.6, abs=0.01)
    envs.reset()
    assert (envs.commands != first).all()


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_rows_are_single_environments_to_the_last_bit(mode: Any, settings: dict) -> None:
    n, settings = 20, settings | {"max_episode_steps": 60}
    envs, singles = make(n, mode, **settings), [gym.make(ID, **settings) for _ in range(n)]
    seen, _ = envs.reset(seed=11)
    assert np.array_equal(seen, [one.reset(seed=11 + i)[0] for i, one in enumerate(singles)])
    over, ends = np.zeros(n, dtype=bool), 0
    for k, actions in enumerate(swinging(n, 200, hold=5)):
        if k == 30:
            mask = np.arange(n) % 2 == 0
            envs.set_command(0.7, mask)
            for i in np.flatnonzero(mask):
                singles[i].unwrapped.set_command(0.7)
        seen, rewards, ended, truncated, info = envs.step(actions)
        for i, one in enumerate(singles):
            if over[i]:  # left over from the last step: mode is NEXT
                assert np.array_equal(seen[i], one.reset()[0])
                over[i] = False
                continue
            expected, *others, last = one.step(actions[i])
            assert [rewards[i], ended[i], truncated[i]] == others
            over[i] = ended[i] or truncated[i]
            if mode is SAME and over[i]:
                assert np.array_equal(info["final_obs"][i], expected)
                assert info["final_info"]["rewarded_travel"][i] == last["rewarded_travel"]
                expected, _ = one.reset()
                over[i] = False
            ends += over[i]
            assert np.array_equal(seen[i], expected)
            assert envs.commands[i] == one.unwrapped.command
    assert ends or mode is SAME


def test_a_change_of_command_is_paid_at_once_and_observed_next() -> None:
    env = RimlessWheelSpeedEnv()
    env.reset(seed=0, options={"mode": "double_stance", "speed": 0.3})
    env.set_command(0.6)
    assert env.command == 0.6
    seen, *_ = env.step(STILL)
    assert seen[6] == pytest.approx(0.75)
    env.reset()
    assert env.command != 0.6  # the next episode draws its own


def test_rows_that_are_not_reset_keep_their_commands() -> None:
    envs, mask = make(4, DISABLED), np.array([True, False, False, True])
    envs.reset(seed=0, options={"speed": [0.3, 0.4, 0.5, 0.6]})
    assert envs.commands.tolist() == [0.3, 0.4, 0.5, 0.6]
    envs.reset(options={"reset_mask": mask, "speed": 0.35, "task": {"slip_penalty": 3.0}})
    assert envs.commands.tolist() == [0.35, 0.4, 0.5, 0.35]
    assert [task.slip_penalty for task in envs.tasks] == [3.0, 1.0, 1.0, 3.0]
    envs.reset(options={"reset_mask": mask, "params": {"slope": 0.01}})
    assert envs.commands[1:3].tolist() == [0.4, 0.5]


def test_snapshots_pickles_and_specs_keep_the_command() -> None:
    env = gym.make(ID, speeds=(0.5, 0.6))
    env.reset(seed=0)
    env.unwrapped.set_command(0.45)
    env.step(STILL)
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
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
    envs = make(3, SAME)
    envs.reset(seed=0)
    other = make(3, SAME)
    other.set_state(envs.get_state())
    for actions in swinging(3, 100, hold=5):
        assert np.array_equal(envs.step(actions)[0], other.step(actions)[0])


def test_defaults_and_a_dictionary_of_prices() -> None:
    assert RimlessWheelSpeedEnv().task == Task(5.0, 0.5, 1.0)
    assert RimlessWheelSpeedEnv(task={"slip_penalty": 3.0}).task == Task(5.0, 0.5, 3.0)
    assert RimlessWheelSpeedVectorEnv(2, task={"slip_penalty": 3.0}).tasks[1] == Task(5.0, 0.5, 3.0)
    assert gym.spec(ID).max_episode_steps == make(1).max_episode_steps == 500
    assert make(1, control_period=0.1).max_episode_steps == 200
    assert gym.make(ID, actions="current").unwrapped.control.by_current


def test_resting_earns_nothing_and_walking_faster_than_commanded_no_more() -> None:
    env = gym.make(ID)
    env.reset(options={"mode": "double_stance", "speed": 0.4})
    total, truncated = 0.0, False
    while not truncated:
        _, reward, _, truncated, _ = env.step(STILL)
        total += reward
    assert total == pytest.approx(-20 * BUILDABLE.idle_power / BUILDABLE.weight)


@pytest.mark.parametrize("make_one", [RimlessWheelSpeedEnv, RimlessWheelSpeedVectorEnv])
@pytest.mark.parametrize(
    ("wrong", "error"),
    [(0.0, ValueError), (2.1, ValueError), (math.nan, ValueError), ("0.5", TypeError)],
)
def test_commands_that_are_no_speed_are_refused_and_change_nothing(
    make_one: Any, wrong: Any, error: type
) -> None:
    env, speed = make_one(), 0.41
    with pytest.raises(RuntimeError, match=r"no episode has begun: call reset\(\) first"):
        env.set_command(speed)
    env.reset(seed=0, options={"speed": speed})
    before = pickle.dumps(env.get_state())
    with pytest.raises(error, match=r"speed = .*must be"):
        env.set_command(wrong)
    with pytest.raises(error, match=r"speed = .*must be"):
        env.reset(seed=1, options={"speed": wrong, "params": "PROTOTYPE"})
    assert pickle.dumps(env.get_state()) == before


@pytest.mark.parametrize(
    ("speeds", "error", "message"),
    [
        ((0.6, 0.3), ValueError, "must be in order"),
        ((0.0, 0.3), ValueError, "greater than 0 and at most 2 m/s"),
        ((0.3, 3.0), ValueError, "greater than 0 and at most 2 m/s"),
        ((0.3, 0.4, 0.5), ValueError, "give one number, or 2"),
        ("fast", TypeError, "must be real numbers"),
        (None, TypeError, "speeds = None: give the least and the greatest"),
    ],
)
@pytest.mark.parametrize("make_one", [RimlessWheelSpeedEnv, RimlessWheelSpeedVectorEnv])
def test_ranges_of_commands_that_are_none_are_refused(
    make_one: Any, speeds: Any, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        make_one(speeds=speeds)


def test_other_prices_within_an_episode_leave_the_command_as_it_is() -> None:
    env, rows = RimlessWheelSpeedEnv(), make(2)
    for one in (env, rows):
        one.reset(seed=0, options={"speed": 0.41})
        one.set_task({"slip_penalty": 3.0})
    assert env.command == 0.41
    assert rows.commands.tolist() == [0.41, 0.41]
    changed, same = RimlessWheelSpeedEnv(), RimlessWheelSpeedEnv()
    for one in (changed, same):
        one.reset(seed=3)
    changed.set_task({"distance_weight": 1.0})
    assert np.array_equal(changed.step(STILL)[0], same.step(STILL)[0])


@pytest.mark.parametrize("make_one", [RimlessWheelSpeedEnv, RimlessWheelSpeedVectorEnv])
def test_a_target_speed_is_refused_because_the_command_takes_its_place(make_one: Any) -> None:
    target = {"target_speed": 0.5}
    with pytest.raises(ValueError, match=r"target_speed = 0\.5: the command takes its place"):
        make_one(task=target)
    env = make_one()
    env.reset(seed=0)
    before = pickle.dumps(env.get_state())
    for change in (
        lambda: env.set_task(target),
        lambda: env.reset(options={"task": target, "params": "PROTOTYPE"}),
    ):
        with pytest.raises(ValueError, match="choose commands by `speeds`"):
            change()
    assert pickle.dumps(env.get_state()) == before


def test_the_plain_environment_takes_no_commands() -> None:
    with pytest.raises(ValueError, match="unknown reset option 'speed'"):
        RimlessWheelEnv().reset(options={"speed": 0.5})
    with pytest.raises(TypeError, match="speeds"):
        gym.make("RimlessWheel-v0", speeds=(0.3, 0.6))
