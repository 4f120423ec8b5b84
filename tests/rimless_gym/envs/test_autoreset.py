"""The end of a row's episode, and what follows in each autoreset mode."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym import THESIS_PHYSICAL
from tests.rimless_gym.envs.rows import DISABLED, NEXT, SAME, make


def test_the_action_of_a_row_that_is_reset_is_ignored_even_if_it_is_nan() -> None:
    envs = make(2, max_episode_steps=1)
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


def test_stepping_before_the_first_reset_is_refused_with_the_remedy() -> None:
    with pytest.raises(RuntimeError, match="reset them first"):
        make(2).step(np.zeros((2, 1), np.float32))


@pytest.mark.parametrize("mode", [NEXT, SAME, DISABLED], ids=lambda mode: mode.value)
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
