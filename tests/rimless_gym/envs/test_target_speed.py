"""Travel is paid up to a target speed."""

from __future__ import annotations

import math
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from hypothesis import given
from hypothesis import strategies as st

from rimless_gym import BUILDABLE, RimlessWheelEnv, Task
from rimless_gym.envs.layout import MEMORY
from rimless_gym.envs.task import rewarded
from tests.rimless_gym.envs.rows import SAME, make, swinging

STEP = BUILDABLE.step_length
TRAVELS = st.lists(st.tuples(st.floats(-0.1, 0.3), st.floats(0.0, 0.1)), max_size=50)


@given(TRAVELS, st.floats(0.01, 3.0))
def test_no_more_is_paid_than_the_target_speed_allows(travels: list, target: float) -> None:
    credit, total, since = STEP, 0.0, 0.0
    for distance, elapsed in travels:
        paid, credit = rewarded(distance, elapsed, credit, STEP, target)
        assert paid <= distance
        assert paid == distance or distance > 0.0  # all backward travel is charged
        assert 0.0 <= credit <= STEP
        total, since = total + paid, since + elapsed
        assert total <= STEP + target * since + 1e-12


@given(TRAVELS)
def test_without_a_target_all_travel_is_paid_to_the_last_bit(travels: list) -> None:
    for distance, elapsed in travels:
        assert rewarded(distance, elapsed, STEP, STEP, math.inf) == (distance, STEP)


def test_a_walk_below_the_target_speed_is_paid_in_full_and_a_faster_one_at_the_target() -> None:
    def walked(speed: float, target: float, seconds: float = 20.0) -> float:
        credit, total = STEP, 0.0
        for k in range(round(seconds / 0.01)):
            pace = speed * (1 + 0.4 * math.sin(2 * math.pi * speed * 0.01 * k / STEP))
            paid, credit = rewarded(pace * 0.01, 0.01, credit, STEP, target)
            total += paid
        return total

    assert walked(0.4, 0.5) == pytest.approx(0.4 * 20, rel=5e-3)
    assert walked(0.5, 0.5) == pytest.approx(0.5 * 20, rel=2e-2)
    assert walked(0.9, 0.5) == pytest.approx(0.5 * 20 + STEP, rel=1e-3)


def test_the_environment_pays_and_remembers_as_the_task_says() -> None:
    env = RimlessWheelEnv(task={"target_speed": 0.3})
    env.reset(seed=0)
    credit, short = STEP, 0
    for action in swinging(1, 600, hold=30)[:, 0]:
        _, _, ended, _, info = env.step(action)
        paid, credit = rewarded(info["distance"], info["elapsed"], credit, STEP, 0.3)
        assert info["rewarded_travel"] == paid
        assert info["reward_distance"] == 0.5 * paid
        assert env.get_state()["batch"]["memory"][MEMORY.allowance, 0] == credit
        if info["slips"]:
            expected = -0.5 * (max(paid, 0.0) + 2.0 * info["elapsed"])
            assert info["reward_slip"] == pytest.approx(expected, rel=1e-15)
        short += paid < info["distance"]
        if ended:
            env.reset()
            credit = STEP
    assert short


def test_rows_with_targets_of_their_own_are_single_environments() -> None:
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


def test_snapshots_and_specs_keep_finite_and_infinite_targets() -> None:
    for target in (0.4, math.inf):
        env = gym.make("RimlessWheel-v0", task=Task(target_speed=target))
        twin = gym.make(EnvSpec.from_json(env.spec.to_json()))
        assert twin.unwrapped.task == env.unwrapped.task
        env.reset(seed=0)
        env.step(np.ones(1, np.float32))
        twin.unwrapped.set_state(pickle.loads(pickle.dumps(env.unwrapped.get_state())))
        ahead, behind = (each.unwrapped.step(np.ones(1, np.float32)) for each in (env, twin))
        assert ahead[1] == behind[1]


@pytest.mark.parametrize("target", [0, -1.0, math.nan, -math.inf, 1e31])
def test_targets_that_are_no_speed_are_refused(target: float) -> None:
    with pytest.raises(ValueError, match=r"target_speed = .*must be"):
        Task(target_speed=target)
