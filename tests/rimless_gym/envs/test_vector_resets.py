"""Resets of a vector environment: seeds, masks, machines and starts per row."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_PHYSICAL
from tests.rimless_gym.envs.rows import DISABLED, ROUGH, make, swinging


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
    with pytest.raises(ValueError, match="2 seeds for 3 rows"):
        envs.reset(seed=[1, 2])


def test_a_masked_reset_leaves_other_rows_and_the_callers_options_alone() -> None:
    envs = make(4, DISABLED, **ROUGH)
    envs.reset(seed=0)
    for actions in swinging(4, 5):
        before = envs.step(actions)[0]
    states, options = envs.states, {"reset_mask": np.array([False, True, False, True])}
    after, _ = envs.reset(seed=[None, 5, None, None], options=options)
    assert list(options) == ["reset_mask"]
    assert np.array_equal(after[[0, 2]], before[[0, 2]])
    assert np.array_equal(envs.states[[0, 2]], states[[0, 2]])
    assert not np.any(np.all(after[[1, 3]] == before[[1, 3]], axis=1))
    twin = make(2, **ROUGH)
    assert np.array_equal(after[1], twin.reset(seed=[5, 0])[0][0])


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        ([True, False], TypeError, "NumPy array of bool"),
        (np.array([1, 0]), TypeError, "NumPy array of bool"),
        (np.array([True]), ValueError, "shape"),
        (np.array([False, False]), ValueError, "mark a row"),
    ],
)
def test_invalid_masks_are_refused(mask: Any, error: type, message: str) -> None:
    envs = make(2)
    envs.reset(seed=0)
    with pytest.raises(error, match=message):
        envs.reset(options={"reset_mask": mask})


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
        one = gym.make("RimlessWheel-v0", params=options["params"][i])
        first, _ = one.reset(options={"state": starts[i], "mode": options["mode"][i]})
        assert np.array_equal(first, seen[i])
    actions = swinging(3, 1)[0]
    after, *_ = envs.step(actions)
    assert np.array_equal(after[2], one.step(actions[2])[0])
    only, _ = envs.reset(
        options={"params": uphill, "reset_mask": np.array([True, False, False])},
    )
    assert envs.params == (uphill, uphill, PROTOTYPE)
    assert np.array_equal(only[1:], after[1:])


def test_a_masked_reset_keeps_the_machines_drawn_for_other_rows() -> None:
    envs = make(3, ranges={"slope": (-0.05, 0.05)})
    envs.reset(seed=0)
    slopes = [machine.slope for machine in envs.params]
    assert len(set(slopes)) == 3
    mask = np.array([False, True, False])
    envs.reset(options={"reset_mask": mask, "params": PROTOTYPE})
    now = [machine.slope for machine in envs.params]
    assert now[0] == slopes[0]
    assert now[1] != slopes[1]
    assert [machine.pendulum_mass for machine in envs.params].count(PROTOTYPE.pendulum_mass) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sate": 0}, "unknown reset option 'sate'"),
        ({"params": [THESIS_PHYSICAL]}, "1 machines for 3 rows"),
        ({"state": np.zeros((2, 4))}, "2 states for 3 rows"),
        ({"state": [1.5, 0, 0, 0], "mode": ["single_stance"]}, "1 modes for 3 rows"),
        ({"ranges": {"slope": (0, 2)}}, "slope = 2"),
        (
            {"ranges": {}, "reset_mask": np.array([True, False, False])},
            "'ranges' holds for all rows",
        ),
    ],
)
def test_a_refused_reset_of_a_vector_environment_changes_nothing(
    options: dict, message: str
) -> None:
    envs, twin = make(3), make(3)
    for each in (envs, twin):
        each.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        envs.reset(seed=8, options=options)
    assert envs.params == twin.params
    assert np.array_equal(envs.states, twin.states)
    assert np.array_equal(envs.reset()[0], twin.reset()[0])  # nor the generators


@pytest.mark.parametrize("kind", [np.int64, np.uint8, int])
def test_seeds_can_be_arrays_of_integers(kind: type) -> None:
    envs, plain = make(3), make(3)
    for seed, same in ((np.array(4, kind), 4), (np.array([5, 0, 7], kind), [5, 0, 7])):
        assert np.array_equal(envs.reset(seed=seed)[0], plain.reset(seed=same)[0])
        assert envs.np_random_seed == plain.np_random_seed
        assert all(type(used) is int for used in envs.np_random_seed)


@pytest.mark.parametrize(
    ("seed", "error", "message"),
    [
        ([5, -1, 7], ValueError, "seed = -1: must be an integer of at least 0"),
        (-1, ValueError, "seed = -1"),
        (np.array([5, 6, -7]), ValueError, "seed = -7"),
        (np.array([5, 6]), ValueError, "2 seeds for 3 rows"),
        (2.5, TypeError, "seed = 2.5: must be an integer"),
        (np.array([1.0, 2.0, 3.0]), TypeError, "seed = np.float64"),
        (np.array(1.0), TypeError, r"seed = array\(1.\)"),
        (True, TypeError, "seed = True"),
        (np.array([True, False, True]), TypeError, "seed = np.True_"),
        ([1, True, 3], TypeError, "seed = True"),
        ("abc", TypeError, "seed = 'abc'"),
        (["a", "b", "c"], TypeError, "seed = 'a'"),
        (np.array([[1], [2], [3]]), TypeError, r"seed = array\(\[1\]\)"),
    ],
)
def test_invalid_seeds_are_refused_and_change_nothing(seed: Any, error: type, message: str) -> None:
    envs = gym.make_vec("RimlessWheel-v0", num_envs=3)
    with pytest.raises(error, match=message):
        envs.reset(seed=seed)
    first, _ = envs.reset(seed=0)
    with pytest.raises(error, match=message):
        envs.reset(seed=seed, options={"params": PROTOTYPE})
    assert envs.np_random_seed == (0, 1, 2)
    assert envs.unwrapped.params == (BUILDABLE,) * 3
    twin = make(3)
    assert np.array_equal(first, twin.reset(seed=0)[0])
    assert np.array_equal(envs.reset()[0], twin.reset()[0])
