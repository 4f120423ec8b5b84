"""Rewards: their sum, the behaviour that they favour, and their size."""

from __future__ import annotations

import copy
import math
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import rimless_gym
from rimless_gym import THESIS_PHYSICAL, Task
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.layout import Interval
from rimless_gym.envs.task import TERM_NAMES, TERMS
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTROL_PERIOD, MAX_RATE


def test_reward_terms_sum_to_the_reward_exactly_and_follow_the_definition(env: gym.Env) -> None:
    rng = np.random.default_rng(1)
    task, params = env.unwrapped.task, env.unwrapped.params
    fall = task.distance_weight * task.fall_penalty
    fall += task.horizon * params.idle_power / params.weight
    env.reset(seed=1)
    ends = slips = 0
    for i in range(3000):
        if i % 25 == 0:  # held so long that the wheel sometimes falls
            action = rng.uniform(-1, 1, 1).astype(np.float32)
        _, reward, ended, truncated, info = env.step(action)
        terms = [info[name] for name in TERM_NAMES]
        assert reward == sum(terms)
        assert info["rewarded_travel"] == info["distance"]
        assert terms[0] == task.distance_weight * info["distance"]
        assert terms[1] == -(info["electrical_positive"] + info["idle"]) / params.weight
        back = max(info["distance"], 0.0) + task.slip_penalty * info["elapsed"]
        assert terms[2] == (-task.distance_weight * back if info["slips"] else 0.0)
        assert terms[3] == pytest.approx(-fall if ended else 0.0, rel=1e-15)
        slips += info["slips"]
        if ended or truncated:
            ends += ended
            env.reset()
    assert ends
    assert slips


@pytest.mark.parametrize("by", ["friction_demand", "impulse_friction_demand"])
def test_slipping_costs_more_than_the_travel_while_it_lasts(by: str) -> None:
    """In the foot's stance as in a touchdown's impulse, however far beyond the limit they are."""
    for mu, value in ((1.0, 0.5), (0.6, 10.0)):
        task, params = Task(distance_weight=value), THESIS_PHYSICAL.replace(friction=mu)
        travel = 0.01 * 1.5  # at 1.5 m/s, faster than any hub in a walk
        for demand, slips in ((0.99 * mu, False), (1.01 * mu, True), (math.inf, True)):
            values = dict.fromkeys(Interval._fields, 0.0) | {"elapsed": 0.01, "rewarded_travel": travel}
            interval = SimpleNamespace(**values | {by: demand})
            reward = sum(term(interval, params, task) for term in TERMS)
            assert (reward < 0.0) == slips
            assert math.isfinite(reward)


def test_terms_take_numbers_and_arrays_alike() -> None:
    rng, n = np.random.default_rng(0), 50
    columns = {name: rng.uniform(0.0, 2.0, n) for name in Interval._fields}
    columns["friction_demand"][::7] = np.inf
    rows = [SimpleNamespace(**{k: v[i] for k, v in columns.items()}) for i in range(n)]
    for term in TERMS:
        each = [term(row, THESIS_PHYSICAL, Task()) for row in rows]
        assert np.array_equal(term(SimpleNamespace(**columns), THESIS_PHYSICAL, Task()), each)
        assert len(set(each)) > 1


def test_resting_is_legal_costs_only_idle_power_and_ends_only_by_truncation(env: gym.Env) -> None:
    params = env.unwrapped.params
    env.reset(options={"state": [params.constants.a, 0, 0, 0], "mode": "double_stance"})
    total = 0.0
    for _ in range(rimless_gym.EPISODE_STEPS):
        _, reward, terminated, truncated, info = env.step(np.zeros(1, np.float32))
        total += reward
        assert reward == -info["idle"] / params.weight
        assert not terminated
        if truncated:
            break
    assert truncated
    idle = params.idle_power * rimless_gym.EPISODE_STEPS * CONTROL_PERIOD / params.weight
    assert total == pytest.approx(-idle, rel=1e-12)
    assert info["mode"] == DOUBLE


def test_an_early_end_pays_less_than_resting_for_the_rest_of_the_episode() -> None:
    for idle_power in (0.0, 5.0):
        params = THESIS_PHYSICAL.replace(idle_power=idle_power)
        for task in (Task(), Task(distance_weight=10.0), Task(horizon=100.0)):
            nothing = SimpleNamespace(**dict.fromkeys(Interval._fields, 0.0))
            end, rest = copy.copy(nothing), copy.copy(nothing)
            end.failed, rest.idle = 1.0, idle_power * task.horizon
            rewards = [sum(term(x, params, task) for term in TERMS) for x in (end, rest)]
            assert rewards[0] < rewards[1]


def test_a_lunge_that_ends_in_a_fall_does_not_pay() -> None:
    for value in (0.5, 10.0):
        env, rng = RimlessWheelEnv(task=Task(distance_weight=value)), np.random.default_rng(0)
        for _ in range(40):
            env.reset(options={"mode": "double_stance"})
            total, ended, volts = 0.0, False, rng.uniform(-1, 1, 8)
            for i in range(200):
                _, reward, ended, _, _ = env.step(volts[i // 25 : i // 25 + 1])
                total += reward
                if ended:
                    break
            assert not ended or total < 0


def test_rewards_are_bounded(env: gym.Env) -> None:
    task, machine = env.unwrapped.task, env.unwrapped.params
    p, speed = machine.constants, MAX_RATE * 10 * machine.leg_length  # no step is trusted with more
    current = (machine.voltage_limit + p.K * 20 * MAX_RATE) / machine.armature_resistance
    power = machine.voltage_limit * current + machine.idle_power
    step = task.distance_weight * (2 * speed + task.slip_penalty) + power / machine.weight
    end = task.distance_weight * task.fall_penalty
    end += task.horizon * machine.idle_power / machine.weight
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    for i in range(3000):
        if i % 20 == 0:
            action = np.sign(rng.uniform(-1, 1, 1)).astype(np.float32)
        _, reward, terminated, truncated, _ = env.step(action)
        assert abs(reward) < CONTROL_PERIOD * step + end
        if terminated or truncated:
            env.reset()
