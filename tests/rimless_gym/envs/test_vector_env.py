"""Gymnasium's contract of the vector environments: arrays, autoreset modes, wrappers, pictures."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym import EPISODE_STEPS, THESIS_PHYSICAL, Failure, RimlessWheelVectorEnv
from tests.rimless_gym.envs.rows import DISABLED, NEXT, SAME, make, swinging

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
def test_a_motion_that_cannot_be_followed_ends_its_episode_and_the_other_rows_go_on(
    mode: AutoresetMode,
) -> None:
    forward_only = THESIS_PHYSICAL.replace(impact_law="thesis")
    envs = make(3, mode, params=[THESIS_PHYSICAL, forward_only, THESIS_PHYSICAL])
    backward = {"state": [THESIS_PHYSICAL.constants.a + 0.001, 0.0, -1.0, 0.0]}
    envs.reset(seed=0, options=backward)
    still = np.zeros((3, 1), np.float32)
    _, _, terminated, _, info = envs.step(still)
    assert terminated.tolist() == [False, True, False]
    final = info["final_info"] if mode is SAME else info
    assert final["failure"][1] == Failure.BACKWARD_TOUCHDOWN_UNDER_THE_THESIS_LAW
    assert final["reward_end"][1] < 0
    others = envs.states[[0, 2]]
    assert np.array_equal(others[0], others[1])
    assert np.all(others[:, 5] == -1)  # they took their step back
    if mode is NEXT:
        _, rewards, _, _, info = envs.step(still)
        assert info["elapsed"][1] == rewards[1] == 0
        assert np.all(info["elapsed"][[0, 2]] > 0)
    elif mode is DISABLED:
        with pytest.raises(RuntimeError, match="reset them first"):
            envs.step(still)
        envs.reset(options={"reset_mask": terminated})
    assert np.all(envs.step(still)[-1]["elapsed"] > 0)
