"""Starts, drawn or given, of single environments and rows; seeds, masks, machines and starts."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_PHYSICAL, RimlessWheelEnv, Starts
from rimless_gym.envs.starts import draw_start, normal_force
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, PHI, THETA
from tests.rimless_gym.envs.rows import DISABLED, ID, ROUGH, SAME, make, swinging

WHIRLING = Starts(rest=0.0, moving=0.0, whirling=1.0)


def test_starts_are_random_and_one_in_four_is_at_rest() -> None:
    envs = make(2000)
    seen, info = envs.reset(seed=0)
    assert np.mean(info["mode"] == DOUBLE) == pytest.approx(0.25, abs=0.05)
    assert len(np.unique(seen, axis=0)) == 2000


def test_reset_options_set_state_mode_and_params() -> None:
    env = RimlessWheelEnv()
    env.reset(options={"state": [1.4, 0.3, 1.0, 2.0], "params": PROTOTYPE})
    assert env.params == PROTOTYPE
    assert env.state[:4] == pytest.approx([1.4, 0.3, 1.0, 2.0])
    assert env.model.params == PROTOTYPE
    observation, info = env.reset(options={"mode": "double_stance"})
    assert info["mode"] == DOUBLE
    assert np.array_equal(observation[1:], np.array([0, 1, 0, 0, 1], np.float32))


def test_a_pendulum_can_start_many_turns_away() -> None:
    env, turns = RimlessWheelEnv(), 2 * math.pi * 15_000
    seen = [env.reset(options={"state": [1.5, theta, 0, 0]})[0] for theta in (0.3, 0.3 - turns)]
    assert seen[0] == pytest.approx(seen[1], abs=1e-6)


def test_kinds_of_start_are_drawn_in_their_shares() -> None:
    envs = make(6000, starts={"rest": 2.0, "moving": 3.0, "whirling": 5.0})
    envs.reset(seed=0)
    whirls = np.abs(envs.states[:, DTHETA]) >= 6.0
    assert (envs.states[:, MODE] == DOUBLE).mean() == pytest.approx(0.2, abs=0.02)
    assert whirls.mean() == pytest.approx(0.5, abs=0.1)  # more of these are refused
    assert (envs.states[whirls, MODE] == SINGLE).all()


@pytest.mark.parametrize("params", [BUILDABLE, THESIS_PHYSICAL], ids=["buildable", "thesis"])
def test_whirling_starts_turn_either_way_and_some_voltage_presses_the_foot(params: Any) -> None:
    envs, p = make(1000, params=params, starts=WHIRLING), params.constants
    envs.reset(seed=0)
    x = envs.states
    speed = np.abs(x[:, DTHETA])
    assert speed.min() >= 6.0
    assert speed.max() <= 16.0
    assert 0.3 < (x[:, DTHETA] > 0).mean() < 0.7
    assert (np.abs(x[:, THETA]) <= math.pi).all()
    assert ((x[:, DPHI] >= 0.0) & (x[:, DPHI] <= 2.0)).all()
    assert ((x[:, PHI] >= p.a) & (x[:, PHI] <= p.b)).all()
    assert min(normal_force(params, row, params.voltage_limit) for row in x[:200]) > 0.0
    assert min(normal_force(params, row) for row in x) < 0.0  # some need the voltage


def test_starts_of_the_default_shares_are_the_default_ones_bit_for_bit() -> None:
    seen = make(100).reset(seed=3)[0]
    for starts in ({}, Starts(1.0, 3.0, 0.0), {"rest": 10, "moving": np.int64(30)}):
        assert np.array_equal(make(100, starts=starts).reset(seed=3)[0], seen)


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


def test_seeds_can_be_one_per_row_and_none_keeps_drawing() -> None:
    envs, one = make(3), make(1)
    first, _ = envs.reset(seed=[7, 3, 7])
    assert np.array_equal(first[0], first[2])
    assert np.array_equal(first[1], one.reset(seed=3)[0][0])
    again, _ = envs.reset(seed=[None, 3, None])
    assert np.array_equal(again[1], first[1])
    assert not np.array_equal(again[0], first[0])
    assert np.array_equal(again[0], again[2])
    assert envs.np_random_seed == (7, 3, 7)
    assert len(envs.np_random) == 3


def test_a_masked_reset_leaves_other_rows_and_the_callers_options_alone() -> None:
    envs = make(4, DISABLED, **ROUGH)
    envs.reset(seed=0)
    for actions in swinging(4, 5):
        before = envs.step(actions)[0]
    states, options = envs.states, {"reset_mask": np.array([False, True, False, True])}
    slopes = [params.slope for params in envs.params]
    after, _ = envs.reset(seed=[None, 5, None, None], options=options)
    assert list(options) == ["reset_mask"]
    assert np.array_equal(after[[0, 2]], before[[0, 2]])
    assert np.array_equal(envs.states[[0, 2]], states[[0, 2]])
    assert not np.any(np.all(after[[1, 3]] == before[[1, 3]], axis=1))
    kept = [params.slope == slope for params, slope in zip(envs.params, slopes, strict=True)]
    assert kept == [True, False, True, False]
    twin = make(2, **ROUGH)
    assert np.array_equal(after[1], twin.reset(seed=[5, 0])[0][0])


def test_rows_may_differ_in_machine_and_start() -> None:
    uphill = THESIS_PHYSICAL.replace(slope=-0.02)
    starts = [[1.4, 0.3, 1.0, 2.0], [1.6, 0.0, 0.0, 0.0], PROTOTYPE.constants.a * np.eye(4)[0]]
    options = {
        "params": [THESIS_PHYSICAL, uphill, PROTOTYPE],
        "state": starts,
        "mode": ["single_stance", "single_stance", "double_stance"],
    }
    envs = make(3)
    seen, info = envs.reset(seed=0, options=options)
    assert envs.params == (THESIS_PHYSICAL, uphill, PROTOTYPE)
    assert envs.states[:, :4] == pytest.approx(np.array(starts))
    assert info["mode"].tolist() == [0, 0, 1]
    for i in range(3):
        one = gym.make(ID, params=options["params"][i])
        first, _ = one.reset(options={"state": starts[i], "mode": options["mode"][i]})
        assert np.array_equal(first, seen[i])
    actions = swinging(3, 1)[0]
    after, *_ = envs.step(actions)
    assert np.array_equal(after[2], one.step(actions[2])[0])
    first_row = {"params": uphill, "reset_mask": np.array([True, False, False])}
    only, _ = envs.reset(options=first_row)
    assert envs.params == (uphill, uphill, PROTOTYPE)
    assert np.array_equal(only[1:], after[1:])


def test_rows_draw_the_starts_of_single_environments() -> None:
    settings = ROUGH | {"starts": {"whirling": 1.0}}
    envs = make(10, SAME, **settings)
    singles = [gym.make(ID, **settings) for _ in range(10)]
    seen = envs.reset(seed=5)[0]
    assert np.array_equal(seen, [one.reset(seed=5 + i)[0] for i, one in enumerate(singles)])
    for actions in swinging(10, 60):
        seen, _, ended, _, _ = envs.step(actions)
        for i in np.flatnonzero(ended):
            assert np.array_equal(seen[i], singles[i].reset()[0])
        for i in np.flatnonzero(~ended):
            singles[i].step(actions[i])
