"""Gymnasium's contract of vector environments: spaces, arguments, actions, pictures."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym import THESIS_PHYSICAL, RimlessWheelVectorEnv
from rimless_gym.envs import EPISODE_STEPS
from tests.rimless_gym.envs.rows import NEXT, SAME, make, swinging


def test_returned_arrays_share_no_memory() -> None:
    envs = make(4, SAME, max_episode_steps=3)
    kept = [envs.reset(seed=0)[0]]
    for actions in swinging(4, 7):
        seen, rewards, terminated, truncated, info = envs.step(actions)
        kept += [seen, rewards, terminated, truncated]
        flat = dict(info)
        final = flat.pop("final_info", {})
        kept += [*flat.values(), *final.values()]
    before = [array.copy() for array in kept]
    for array in kept:
        array.flags.writeable = True
    for k, array in enumerate(kept):
        array[...] = 1  # reaches no other array, nor the environment
        before[k][...] = 1
        assert all(np.array_equal(a, b) for a, b in zip(kept, before, strict=True))
    other = make(4, SAME, max_episode_steps=3)
    other.reset(seed=0)
    for actions in swinging(4, 7):
        other.step(actions)
    assert np.array_equal(envs.step(swinging(4, 1)[0])[0], other.step(swinging(4, 1)[0])[0])


def test_spaces_and_metadata_follow_gymnasiums_contract() -> None:
    envs = make(3, SAME)
    assert envs.metadata["autoreset_mode"] is SAME
    assert RimlessWheelVectorEnv.metadata["autoreset_mode"] is NEXT
    seen, _ = envs.reset(seed=0)
    assert seen in envs.observation_space
    assert envs.observation_space.shape == (3, *envs.single_observation_space.shape)
    envs.action_space.seed(0)
    seen, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert seen in envs.observation_space
    assert rewards.dtype == np.float64
    assert terminated.dtype == truncated.dtype == np.bool_
    assert envs.spec is not None
    assert envs.max_episode_steps == EPISODE_STEPS


@pytest.mark.parametrize("wrapper", ["RecordEpisodeStatistics", "DictInfoToList"])
@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_gymnasiums_vector_wrappers_work(wrapper: str, mode: AutoresetMode) -> None:
    envs = getattr(gym.wrappers.vector, wrapper)(make(3, mode, max_episode_steps=30))
    envs.reset(seed=0)
    lengths = []
    for actions in swinging(3, 100):
        info = envs.step(actions)[-1]
        if wrapper == "DictInfoToList":
            assert isinstance(info[0]["distance"], float)
        elif "episode" in info:
            lengths += info["episode"]["l"][info["_episode"]].tolist()
    assert wrapper == "DictInfoToList" or max(lengths) == 30


def test_nan_and_wrong_shapes_are_refused_by_row_and_change_nothing() -> None:
    envs = make(3)
    envs.reset(seed=0)
    states = envs.states
    actions = np.zeros((3, 1), np.float32)
    actions[[0, 2]] = np.nan
    with pytest.raises(ValueError, match=r"rows \[0, 2\] are NaN"):
        envs.step(actions)
    for shape in ((3,), (1, 3), (2, 1)):
        with pytest.raises(ValueError, match="shape"):
            envs.step(np.zeros(shape, np.float32))
    assert np.array_equal(envs.states, states)


@pytest.mark.parametrize("wrong", [None, "0.5", 0.5 + 0j, {}, 10**400], ids=lambda x: str(x)[:9])
def test_actions_that_are_not_numbers_are_refused(wrong: Any) -> None:
    envs = make(2)
    envs.reset(seed=0)
    before = envs.get_state()["batch"]["memory"]
    for actions in (wrong, [[0.5], [wrong]], np.array([[0.5], [wrong]], object)):
        with pytest.raises(TypeError, match=r"(?s)actions = .*: must be real numbers"):
            envs.step(actions)
    assert np.array_equal(envs.get_state()["batch"]["memory"], before)


def test_absurd_voltages_never_give_nan() -> None:
    machines = [THESIS_PHYSICAL.replace(voltage_limit=10.0**k) for k in range(1, 8)]
    envs = make(7, params=machines)
    envs.reset(seed=0)
    for actions in swinging(7, 200, hold=5):
        try:
            seen, rewards, _, _, info = envs.step(actions)
        except RuntimeError:  # a row's motion left the model's range
            continue
        assert np.isfinite(seen).all()
        assert np.isfinite(rewards).all()
        assert not any(np.isnan(values).any() for values in info.values())


def test_invalid_arguments_are_refused() -> None:
    for settings in (
        {"num_envs": 0},
        {"num_threads": 0},
        {"max_episode_steps": 0},
        {"autoreset_mode": "sometimes"},
        {"render_mode": "human"},
        {"params": [THESIS_PHYSICAL] * 3, "num_envs": 2},
    ):
        with pytest.raises(ValueError, match=r"must be|choose from|not a valid"):
            RimlessWheelVectorEnv(**settings)
    for settings in ({"params": 1.4}, {"task": 1}, {"ranges": 3}, {"disturbances": 0}):
        with pytest.raises(TypeError, match="give a"):
            RimlessWheelVectorEnv(**settings)


@pytest.mark.parametrize("name", ["num_envs", "num_threads", "max_episode_steps"])
@pytest.mark.parametrize("value", ["a", "3", math.nan, 2.5, 2.0, True, np.bool_(True), [2]])
def test_counts_must_be_integers(name: str, value: Any) -> None:
    with pytest.raises(TypeError, match=rf"{name} = .*: must be an integer of at least 1"):
        RimlessWheelVectorEnv(**{name: value})
    with pytest.raises(TypeError, match=rf"{name} = "):
        gym.make_vec("RimlessWheel-v0", **{name: value})


def test_counts_can_be_numpy_integers_and_limits_can_be_huge() -> None:
    envs = RimlessWheelVectorEnv(np.int64(2), num_threads=np.uint8(1), max_episode_steps=np.int8(3))
    assert [type(n) for n in (envs.num_envs, envs.max_episode_steps)] == [int, int]
    assert RimlessWheelVectorEnv(max_episode_steps=10**30).max_episode_steps == 10**30


def test_rendering_gives_the_single_environments_frame_of_each_row() -> None:
    envs = make(3, render_mode="rgb_array")
    with pytest.raises(RuntimeError, match="reset"):
        envs.render()
    envs.reset(seed=0)
    first = envs.render()
    for i, frame in enumerate(first):
        single = gym.make("RimlessWheel-v0", render_mode="rgb_array")
        single.reset(seed=i)
        assert np.array_equal(frame, single.render())
    envs.step(np.ones((3, 1), np.float32))
    second = envs.render()
    assert isinstance(second, tuple)
    assert len(second) == 3
    assert not np.array_equal(first[0], second[0])
