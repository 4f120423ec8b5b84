"""Rewards: their sum, the behaviour that they favour, and travel up to a target speed."""

from __future__ import annotations

import copy
import functools
import math
import operator
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rimless_gym
from rimless_gym import BUILDABLE, THESIS_PHYSICAL, RimlessWheelEnv, Task
from rimless_gym.envs.layout import MEMORY, Interval
from rimless_gym.envs.task import TERM_NAMES, TERMS, rewarded
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTROL_PERIOD, MAX_RATE
from tests.rimless_gym.envs.rows import ID, SAME, STILL, make, swinging

STEP = BUILDABLE.step_length
TRAVELS = st.lists(st.tuples(st.floats(-0.1, 0.3), st.floats(0.0, 0.1)), max_size=50)


def added(terms: list) -> float:
    """The terms added from left to right: since Python 3.12, `sum` compensates for rounding."""
    return functools.reduce(operator.add, terms)


def test_the_terms_added_from_left_to_right_are_the_reward_and_follow_the_definition() -> None:
    env: RimlessWheelEnv = gym.make(ID).unwrapped  # type: ignore[assignment]
    rng, task, params = np.random.default_rng(1), env.task, env.params
    fall = task.distance_weight * task.fall_penalty
    fall += task.horizon * params.idle_power / params.weight
    env.reset(seed=1)
    ends = slips = 0
    for i in range(1500):
        if i % 25 == 0:  # held so long that the wheel sometimes falls
            action = rng.uniform(-1, 1, 1).astype(np.float32)
        _, reward, ended, _, info = env.step(action)
        terms, info = [info[name] for name in TERM_NAMES], env.measurements
        assert reward == added(terms)
        assert info["rewarded_travel"] == info["distance"]
        assert terms[0] == task.distance_weight * info["distance"]
        assert terms[1] == -(info["electrical_positive"] + info["idle"]) / params.weight
        back = max(info["distance"], 0.0) + task.slip_penalty * info["elapsed"]
        assert terms[2] == (-task.distance_weight * back if info["slips"] else 0.0)
        assert terms[3] == pytest.approx(-fall if ended else 0.0, rel=1e-15)
        slips += info["slips"]
        if ended:
            ends += ended
            env.reset()
    assert ends
    assert slips


@pytest.mark.parametrize("by", ["friction_demand", "impulse_friction_demand"])
def test_slipping_costs_more_than_the_travel_while_it_lasts(by: str) -> None:
    """In the foot's stance as in a touchdown's impulse, however far beyond the limit they are."""
    for mu, weight in ((1.0, 0.5), (0.6, 10.0)):
        task, params = Task(distance_weight=weight), THESIS_PHYSICAL.replace(friction=mu)
        travel = 0.01 * 1.5  # at 1.5 m/s, faster than any hub in a walk
        for demand, slips in ((0.99 * mu, False), (1.01 * mu, True), (math.inf, True)):
            values = dict.fromkeys(Interval._fields, 0.0) | {"elapsed": 0.01, by: demand}
            interval = SimpleNamespace(**values | {"rewarded_travel": travel})
            reward = sum(term(interval, params, task) for term in TERMS)
            assert (reward < 0.0) == slips
            assert math.isfinite(reward)


def test_resting_is_legal_costs_only_idle_power_and_ends_only_by_truncation() -> None:
    env = gym.make(ID)
    params, total, truncated = env.unwrapped.params, 0.0, False
    env.reset(options={"mode": "double_stance"})
    while not truncated:
        _, reward, terminated, truncated, info = env.step(STILL)
        total += reward
        assert reward == -env.unwrapped.measurements["idle"] / params.weight
        assert not terminated
    idle = params.idle_power * rimless_gym.EPISODE_STEPS * CONTROL_PERIOD / params.weight
    assert total == pytest.approx(-idle, rel=1e-12)
    assert info["mode"] == DOUBLE


def test_an_early_end_is_worse_than_resting_for_the_rest_of_the_episode() -> None:
    for idle_power in (0.0, 5.0):
        params = THESIS_PHYSICAL.replace(idle_power=idle_power)
        for task in (Task(), Task(distance_weight=10.0), Task(horizon=100.0)):
            nothing = SimpleNamespace(**dict.fromkeys(Interval._fields, 0.0))
            end, rest = copy.copy(nothing), copy.copy(nothing)
            end.failed, rest.idle = 1.0, idle_power * task.horizon
            rewards = [sum(term(x, params, task) for term in TERMS) for x in (end, rest)]
            assert rewards[0] < rewards[1]


def test_rewards_are_bounded() -> None:
    envs, task, params = make(50, SAME), Task(), BUILDABLE
    speed = MAX_RATE * 10 * params.leg_length  # no step is trusted with more
    current = params.voltage_limit + params.constants.K * 20 * MAX_RATE
    power = params.voltage_limit * current / params.armature_resistance + params.idle_power
    step = task.distance_weight * (2 * speed + task.slip_penalty) + power / params.weight
    end = task.distance_weight * task.fall_penalty
    end += task.horizon * params.idle_power / params.weight
    envs.reset(seed=0)
    for actions in np.sign(swinging(50, 100)):
        assert np.abs(envs.step(actions)[1]).max() < CONTROL_PERIOD * step + end


@given(TRAVELS, st.floats(0.01, 3.0))
def test_no_more_is_rewarded_than_the_target_speed_allows(travels: list, target: float) -> None:
    allowance, total, since = STEP, 0.0, 0.0
    for distance, elapsed in travels:
        travel, allowance = rewarded(distance, elapsed, allowance, STEP, target)
        assert travel <= distance
        assert travel == distance or distance > 0.0  # all backward travel counts
        assert 0.0 <= allowance <= STEP
        total, since = total + travel, since + elapsed
        assert total <= STEP + target * since + 1e-12
        assert rewarded(distance, elapsed, STEP, STEP, math.inf) == (distance, STEP)


def test_a_walk_below_the_target_speed_is_rewarded_in_full_and_a_faster_one_at_the_target() -> None:
    def walked(speed: float, target: float) -> float:
        allowance, total = STEP, 0.0
        for k in range(2000):
            pace = speed * (1 + 0.4 * math.sin(2 * math.pi * speed * 0.01 * k / STEP))
            travel, allowance = rewarded(pace * 0.01, 0.01, allowance, STEP, target)
            total += travel
        return total

    assert walked(0.4, 0.5) == pytest.approx(0.4 * 20, rel=5e-3)
    assert walked(0.5, 0.5) == pytest.approx(0.5 * 20, rel=2e-2)
    assert walked(0.9, 0.5) == pytest.approx(0.5 * 20 + STEP, rel=1e-3)


def test_the_environment_rewards_and_remembers_as_the_task_defines() -> None:
    env = RimlessWheelEnv(task={"target_speed": 0.3})
    env.reset(seed=0)
    allowance, short = STEP, 0
    for action in swinging(1, 600, hold=30)[:, 0]:
        _, _, ended, _, _ = env.step(action)
        info = env.measurements
        travel, allowance = rewarded(info["distance"], info["elapsed"], allowance, STEP, 0.3)
        assert info["rewarded_travel"] == travel
        assert info["reward_distance"] == 0.5 * travel
        assert env.get_state()["batch"]["memory"][MEMORY.allowance, 0] == allowance
        if info["slips"]:
            expected = -0.5 * (max(travel, 0.0) + 2.0 * info["elapsed"])
            assert info["reward_slip"] == pytest.approx(expected, rel=1e-15)
        short += travel < info["distance"]
        if ended:
            env.reset()
            allowance = STEP
    assert short


def test_rows_with_different_targets_are_single_environments() -> None:
    tasks = [Task(target_speed=v) for v in (0.2, 0.5, math.inf)]
    envs = make(3, SAME, ranges={"leg_length": (0.28, 0.32)})
    singles = [RimlessWheelEnv(task=task, ranges={"leg_length": (0.28, 0.32)}) for task in tasks]
    envs.reset(seed=0, options={"task": tasks})
    for i, one in enumerate(singles):
        one.reset(seed=i)
    for actions in swinging(3, 300):
        _, rewards, ended, _, _ = envs.step(actions)
        for i, one in enumerate(singles):
            assert rewards[i] == one.step(actions[i])[1]
            if ended[i]:
                one.reset()


def test_a_task_can_be_changed_between_episodes_and_holds_until_changed_again() -> None:
    env = RimlessWheelEnv(task={"fall_penalty": 3.0})
    env.reset(seed=0, options={"task": {"distance_weight": 2.0}})
    assert env.task == Task(distance_weight=2.0, fall_penalty=3.0)
    for _ in range(2):
        _, _, _, _, info = env.step(np.ones(1, np.float32))
        assert info["reward_distance"] == 2.0 * info["distance"]
        env.reset()
    env.reset(options={"task": Task()})
    assert env.task == Task()


def test_tasks_change_in_the_rows_that_are_reset_only() -> None:
    envs = make(4, SAME, max_episode_steps=3)
    envs.reset(seed=0)
    mask, weights = np.array([True, False, True, False]), np.array([3.0, 0.5, 3.0, 0.5])
    envs.reset(options={"task": {"distance_weight": 3.0}, "reset_mask": mask})
    assert [task.distance_weight for task in envs.tasks] == weights.tolist()
    for _ in range(5):  # also after autoresets
        info = envs.step(np.zeros((4, 1), np.float32))[-1]
        info = info.get("final_info", info)
        assert info["distance"].any()
        assert np.array_equal(info["reward_distance"], weights * info["distance"])
    envs.reset(options={"task": [Task(distance_weight=v) for v in (1.0, 2.0, 3.0, 4.0)]})
    assert [task.distance_weight for task in envs.tasks] == [1.0, 2.0, 3.0, 4.0]
    envs.set_task({"slip_penalty": 1.0}, mask)
    assert [task.slip_penalty for task in envs.tasks] == [1.0, 2.0, 1.0, 2.0]
    assert [task.distance_weight for task in envs.tasks] == [1.0, 2.0, 3.0, 4.0]
