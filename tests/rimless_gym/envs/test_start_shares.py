"""Which kinds of start are drawn, and tasks and starts that change between episodes."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL, RimlessWheelEnv, RimlessWheelVectorEnv, Starts
from rimless_gym.envs.starts import draw_start, normal_force
from rimless_gym.envs.task import Task
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, PHI, THETA
from tests.rimless_gym.envs.rows import ROUGH, SAME, make, swinging

WHIRLING = Starts(rest=0.0, moving=0.0, whirling=1.0)


def test_kinds_of_start_are_drawn_in_their_shares() -> None:
    envs = make(6000, starts={"rest": 2.0, "moving": 3.0, "whirling": 5.0})
    envs.reset(seed=0)
    whirls = np.abs(envs.states[:, DTHETA]) >= 6.0
    assert (envs.states[:, MODE] == DOUBLE).mean() == pytest.approx(0.2, abs=0.02)
    assert whirls.mean() == pytest.approx(0.5, abs=0.1)  # more of these are refused
    assert (envs.states[whirls, MODE] == SINGLE).all()


@pytest.mark.parametrize("params", [BUILDABLE, THESIS_PHYSICAL], ids=["buildable", "thesis"])
def test_whirling_starts_turn_either_way_and_some_voltage_presses_the_foot(params: Any) -> None:
    envs, p = make(3000, params=params, starts=WHIRLING), params.constants
    envs.reset(seed=0)
    x = envs.states
    speed = np.abs(x[:, DTHETA])
    assert speed.min() >= 6.0
    assert speed.max() <= 16.0
    assert 0.3 < (x[:, DTHETA] > 0).mean() < 0.7
    assert (np.abs(x[:, THETA]) <= math.pi).all()
    assert ((x[:, DPHI] >= 0.0) & (x[:, DPHI] <= 2.0)).all()
    assert ((x[:, PHI] >= p.a) & (x[:, PHI] <= p.b)).all()
    forces = [normal_force(params, row, params.voltage_limit) for row in x[:200]]
    assert min(forces) > 0.0
    assert min(normal_force(params, row) for row in x) < 0.0  # some need the voltage


def test_starts_of_the_usual_shares_are_the_default_ones_bit_for_bit() -> None:
    for starts in (None, {}, Starts(), Starts(1.0, 3.0, 0.0), {"rest": 10, "moving": np.int64(30)}):
        envs = make(100, starts=starts)
        assert np.array_equal(envs.reset(seed=3)[0], make(100).reset(seed=3)[0])


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
def test_rows_draw_the_starts_of_single_environments(settings: dict) -> None:
    settings = settings | {"starts": {"whirling": 1.0}}
    envs = make(20, SAME, **settings)
    singles = [gym.make("RimlessWheel-v0", **settings) for _ in range(20)]
    seen = envs.reset(seed=5)[0]
    assert np.array_equal(seen, [one.reset(seed=5 + i)[0] for i, one in enumerate(singles)])
    for actions in swinging(20, 100):
        seen, _, ended, truncated, _ = envs.step(actions)
        for i in np.flatnonzero(ended | truncated):
            assert np.array_equal(seen[i], singles[i].reset()[0])
        for i in np.flatnonzero(~ended & ~truncated):
            singles[i].step(actions[i])


def test_the_function_that_draws_starts_draws_those_of_an_environment() -> None:
    env = RimlessWheelEnv(starts=WHIRLING)
    for seed in range(5):
        env.reset(seed=seed)
        drawn = draw_start(BUILDABLE, np.random.default_rng(seed), WHIRLING)
        assert np.array_equal(env.state, drawn)


def test_starts_can_be_changed_between_episodes_and_hold_until_changed_again() -> None:
    env, envs = RimlessWheelEnv(), make(5)

    def rates(options: dict) -> np.ndarray:
        env.reset(seed=0, options=options)
        envs.reset(seed=0, options=options)
        return np.abs([env.state[DTHETA], *envs.states[:, DTHETA]])

    assert (rates({"starts": WHIRLING}) >= 6.0).all()
    assert (rates({}) >= 6.0).all()
    assert (rates({"starts": None}) <= 3.0).all()


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
    mask = np.array([True, False, True, False])
    envs.reset(options={"task": {"distance_weight": 3.0}, "reset_mask": mask})
    assert [task.distance_weight for task in envs.tasks] == [3.0, 0.5, 3.0, 0.5]
    for _ in range(5):  # also after autoresets
        info = envs.step(np.zeros((4, 1), np.float32))[-1]
        info = info.get("final_info", info)
        assert info["distance"].any()
        assert np.array_equal(
            info["reward_distance"], np.array([3.0, 0.5, 3.0, 0.5]) * info["distance"]
        )
    envs.reset(options={"task": [Task(distance_weight=v) for v in (1.0, 2.0, 3.0, 4.0)]})
    assert [task.distance_weight for task in envs.tasks] == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"task": {"value": 1.0}}, ValueError, "task: 'value' is not a field of Task"),
        ({"task": {"fall_penalty": -1.0}}, ValueError, "fall_penalty = -1.0: must be at least 0"),
        ({"task": "walk"}, TypeError, "task = 'walk': give a rimless_gym.Task"),
        ({"task": [Task()] * 3}, ValueError, "task: 3 tasks for 1 rows"),
        ({"starts": {"rest": -1.0}}, ValueError, "rest = -1.0: must be at least 0"),
        ({"starts": {"lying": 1.0}}, ValueError, "starts: 'lying' is not a field of Starts"),
        ({"starts": {"rest": 0, "moving": 0}}, ValueError, "one of the shares must be greater"),
        ({"starts": {"rest": math.inf}}, ValueError, "rest = inf: must be finite"),
        ({"starts": {"rest": "1"}}, TypeError, "rest = '1': must be a real number"),
        ({"starts": 1.0}, TypeError, "starts = 1.0: give a rimless_gym.Starts or a dictionary"),
    ],
)
@pytest.mark.parametrize("make_one", [RimlessWheelEnv, RimlessWheelVectorEnv])
def test_invalid_tasks_and_starts_are_refused_and_change_nothing(
    make_one: Any, options: dict, error: type, message: str
) -> None:
    env, other = make_one(), make_one()
    good = {"task": {"distance_weight": 9.0}, "starts": WHIRLING}
    for each in (env, other):
        each.reset(seed=0)
    with pytest.raises(error, match=message):
        env.reset(options=good | options)
    assert np.array_equal(env.reset()[0], other.reset()[0])
    assert env.get_state()["batch"]["tasks"] == [Task()]
    if "starts" in options:
        with pytest.raises(error, match=message):
            make_one(**options)


def test_starts_hold_for_all_rows() -> None:
    with pytest.raises(ValueError, match="'starts' holds for all rows: give no reset_mask"):
        make(2).reset(options={"starts": WHIRLING, "reset_mask": np.array([True, False])})
