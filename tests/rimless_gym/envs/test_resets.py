"""Starts of the single environment, drawn or given."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_PHYSICAL
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import MAX_RATE


def test_starts_are_random_and_include_rest(env: gym.Env) -> None:
    modes = [env.reset(seed=seed)[1]["mode"] for seed in range(200)]
    assert 20 < modes.count(DOUBLE) < 80
    observations = [env.reset(seed=seed)[0] for seed in range(20)]
    assert len(np.unique(observations, axis=0)) == 20


def test_reset_options_set_state_mode_and_params() -> None:
    env = RimlessWheelEnv()
    env.reset(options={"state": [1.4, 0.3, 1.0, 2.0], "params": PROTOTYPE})
    assert env.params == PROTOTYPE
    assert env.state[:4] == pytest.approx([1.4, 0.3, 1.0, 2.0])
    assert env.model.params == PROTOTYPE


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sate": [1.4, 0, 0, 0]}, "unknown reset option 'sate'"),
        ({"state": [0.1, 0, 0, 0]}, "phi = 0.1"),
        (
            {"params": THESIS_PHYSICAL, "state": [1.5, 3.0, 0, MAX_RATE]},
            r"no voltage from -20 to 20 V .* largest force is -.* greater than 0: give a slower",
        ),
        ({"state": [1.5, 1e300, 0, 0]}, r"theta = 1e\+300: must be within 100000 rad"),
        ({"state": [1.5, -1e17, 0, 0]}, r"theta = -1e\+17: .* modulo 2 pi"),
        ({"state": [1.5, math.inf, 0, 0]}, "four finite numbers"),
        ({"state": [1.5, 0, math.nan, 0]}, "four finite numbers"),
        ({"state": [1.5, 0, 0]}, "four finite numbers"),
        ({"state": 1.5}, "four finite numbers"),
        ({"state": [[1.5, 0, 0, 0], [1.5]]}, "rows of one length"),
        ({"state": [1.5, 0, 0, 0], "mode": "flying"}, "mode = 'flying'"),
        ({"mode": "single_stance"}, "goes with 'state'"),
        ({"mode": np.array(["double_stance"] * 2)}, "goes with 'state'"),
        ({"params": THESIS_PHYSICAL.replace(armature_resistance=1e-6)}, "motor damps"),
        ({"params": "CONCRETE"}, "'CONCRETE': choose from BUILDABLE, .*PROTOTYPE"),
    ],
)
def test_bad_reset_options_are_refused_by_name(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RimlessWheelEnv().reset(options=options)


@pytest.mark.parametrize("state", [["1.5", "0", "0", "0"], "hanging", None, [1.5, 0, 0, 1j], {}])
def test_states_that_are_not_numbers_are_refused(state: Any) -> None:
    with pytest.raises(TypeError, match=r"state = .*must be real numbers"):
        RimlessWheelEnv().reset(options={"state": state})


def test_a_mode_must_be_a_name_or_one_per_row() -> None:
    with pytest.raises(TypeError, match="mode = 3: give a name"):
        RimlessWheelEnv().reset(options={"state": [1.5, 0, 0, 0], "mode": 3})


def test_a_pendulum_can_start_many_turns_away() -> None:
    env, turns = RimlessWheelEnv(), 2 * math.pi * 15_000
    seen = [env.reset(options={"state": [1.5, theta, 0, 0]})[0] for theta in (0.3, 0.3 - turns)]
    assert seen[0] == pytest.approx(seen[1], abs=1e-6)


def test_a_refused_reset_changes_nothing() -> None:
    env = RimlessWheelEnv()
    env.reset(seed=0)
    before = env.state
    with pytest.raises(ValueError, match="phi = 9"):
        env.reset(options={"params": PROTOTYPE, "state": [9, 9, 9, 9]})
    assert env.params == BUILDABLE
    assert np.array_equal(env.state, before)


def test_double_stance_without_a_state_starts_at_rest() -> None:
    env = RimlessWheelEnv()
    observation, info = env.reset(options={"mode": "double_stance"})
    assert info["mode"] == DOUBLE
    assert np.array_equal(observation[1:], np.array([0, 1, 0, 0, 1], np.float32))


@pytest.mark.parametrize("seed", [np.array(7), np.uint8(7), np.array(7, np.int16)])
def test_seeds_can_be_numpy_integers(seed: Any) -> None:
    env, plain = RimlessWheelEnv(), RimlessWheelEnv()
    assert np.array_equal(env.reset(seed=seed)[0], plain.reset(seed=7)[0])
    assert env.np_random_seed == 7


@pytest.mark.parametrize(
    ("seed", "error"),
    [(2.0, TypeError), (True, TypeError), ("7", TypeError), (-1, ValueError), ([7], TypeError)],
)
def test_invalid_seeds_are_refused_and_change_nothing(seed: Any, error: type) -> None:
    env = RimlessWheelEnv()
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(error, match=r"seed = .*: must be an integer of at least 0"):
        env.reset(seed=seed, options={"params": PROTOTYPE})
    assert env.params == BUILDABLE
    assert env.np_random_seed == 0
    assert env.get_state()["generators"] == before["generators"]
