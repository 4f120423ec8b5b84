"""Gymnasium's contract of the vector environments: arrays, autoreset modes, wrappers, pictures."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym import EPISODE_STEPS, THESIS_PHYSICAL, RimlessWheelVectorEnv
from tests.rimless_gym.envs.rows import DISABLED, ID, NEXT, SAME, make, swinging

EACH_MODE = pytest.mark.parametrize("mode", [NEXT, SAME, DISABLED], ids=lambda mode: mode.value)


def test_returned_arrays_share_no_memory() -> None:
    envs = make(4, SAME, max_episode_steps=3)
    arrays = [envs.reset(seed=0)[0]]
    for actions in swinging(4, 7):
        seen, rewards, terminated, truncated, info = envs.step(actions)
        arrays += [seen, rewards, terminated, truncated]
        flat = dict(info)
        final = flat.pop("final_info", {})
        arrays += [*flat.values(), *final.values()]
    before = [array.copy() for array in arrays]
    for k, array in enumerate(arrays):
        array[...] = 1  # reaches no other array, nor the environment
        before[k][...] = 1
        assert all(np.array_equal(a, b) for a, b in zip(arrays, before, strict=True))
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


@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_every_reset_and_step_has_the_same_entries_each_of_one_type(mode: AutoresetMode) -> None:
    envs, kinds, lasts = make(3, mode), set(), 0

    def see(info: dict[str, Any]) -> None:
        kinds.add(tuple(sorted((name, each.dtype, each.shape) for name, each in info.items())))

    see(envs.reset(seed=0)[1])
    for actions in swinging(3, 400):
        info = envs.step(actions)[-1]
        final = {name: info.pop(name) for name in list(info) if "final" in name}
        see(info)
        if final:
            lasts += 1
            see(final["final_info"])
            assert final["final_info"]["failure"][final["_final_info"]].all()
    assert len(kinds) == 1
    assert (lasts > 0) == (mode is SAME)


@pytest.mark.parametrize("wrapper", ["RecordEpisodeStatistics", "DictInfoToList"])
@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_gymnasiums_vector_wrappers_work(wrapper: str, mode: AutoresetMode) -> None:
    envs = getattr(gym.wrappers.vector, wrapper)(make(3, mode, max_episode_steps=30))
    envs.reset(seed=0)
    lengths = []
    for actions in swinging(3, 70):
        info = envs.step(actions)[-1]
        if wrapper == "DictInfoToList":
            assert isinstance(info[0]["distance"], float)
        elif "episode" in info:
            lengths += info["episode"]["l"][info["_episode"]].tolist()
    assert wrapper == "DictInfoToList" or max(lengths) == 30


def test_absurd_voltages_never_give_nan() -> None:
    envs = make(7, params=[THESIS_PHYSICAL.replace(voltage_limit=10.0**k) for k in range(1, 8)])
    envs.reset(seed=0)
    for actions in swinging(7, 100, hold=5):
        try:
            seen, rewards, _, _, info = envs.step(actions)
        except RuntimeError:  # a row's motion left the model's range
            continue
        assert np.isfinite(seen).all()
        assert np.isfinite(rewards).all()
        assert not any(np.isnan(values).any() for values in info.values())


def test_rendering_gives_the_single_environments_frame_of_each_row() -> None:
    envs = make(2, render_mode="rgb_array")
    with pytest.raises(RuntimeError, match="reset"):
        envs.render()
    envs.reset(seed=0)
    first = envs.render()
    for i, frame in enumerate(first):
        single = gym.make(ID, render_mode="rgb_array")
        single.reset(seed=i)
        assert np.array_equal(frame, single.render())
    envs.step(np.ones((2, 1), np.float32))
    second = envs.render()
    assert isinstance(second, tuple)
    assert len(second) == 2
    assert not np.array_equal(first[0], second[0])


def test_the_action_of_a_row_that_is_reset_is_ignored_even_if_it_is_nan() -> None:
    envs = make(2, max_episode_steps=1)
    with pytest.raises(RuntimeError, match="reset them first"):
        envs.step(np.zeros((2, 1), np.float32))
    envs.reset(seed=0)
    assert envs.step(np.zeros((2, 1), np.float32))[3].all()
    _, rewards, *_ = envs.step(np.full((2, 1), np.nan, np.float32))
    assert not rewards.any()


def test_without_autoreset_an_ended_row_must_be_reset_first() -> None:
    envs = make(2, DISABLED, max_episode_steps=2)
    with pytest.raises(RuntimeError, match=r"rows \[0, 1\] have no episode"):
        envs.step(np.zeros((2, 1), np.float32))
    envs.reset(seed=0)
    for _ in range(2):
        truncated = envs.step(np.zeros((2, 1), np.float32))[3]
    assert truncated.all()
    with pytest.raises(RuntimeError, match="reset them first"):
        envs.step(np.zeros((2, 1), np.float32))
    envs.reset(options={"reset_mask": truncated})
    assert not envs.step(np.zeros((2, 1), np.float32))[3].any()


@EACH_MODE
def test_a_motion_that_leaves_the_models_range_names_its_row_and_the_others_go_on(
    mode: AutoresetMode,
) -> None:
    forward_only = THESIS_PHYSICAL.replace(impact_law="thesis")
    envs = make(3, mode, params=[THESIS_PHYSICAL, forward_only, THESIS_PHYSICAL])
    backward = {"state": [THESIS_PHYSICAL.constants.a + 0.001, 0.0, -1.0, 0.0]}
    envs.reset(seed=0, options=backward)
    still = np.zeros((3, 1), np.float32)
    with pytest.raises(RuntimeError, match="row 1: the motion left the model's range"):
        envs.step(still)
    others = envs.states[[0, 2]]
    assert np.array_equal(others[0], others[1])
    assert np.all(others[:, 5] == -1)  # they took their step back
    if mode is NEXT:
        _, rewards, _, _, info = envs.step(still)
        assert info["elapsed"][1] == rewards[1] == 0
        assert np.all(info["elapsed"][[0, 2]] > 0)
    else:
        if mode is DISABLED:
            with pytest.raises(RuntimeError, match="reset them first"):
                envs.step(still)
        envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.all(envs.step(still)[-1]["elapsed"] > 0)
