"""Observations, and the prices of a task."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.layout import OBSERVATION_BOUND, observe
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import MAX_RATE, Failure
from rimless_gym.kernel.stepping import STATE_SIZE

P = THESIS_PHYSICAL
ANY = st.floats(-1e4, 1e4)
STATES = st.tuples(ANY, ANY, ANY, ANY, st.sampled_from([0.0, 1.0]), st.just(0.0)).map(np.array)


def unbounded(x: np.ndarray) -> np.ndarray:
    leg = (x[0] - math.pi / 2) / (P.leg_angle / 2)
    return np.array([leg, math.sin(x[1]), math.cos(x[1]), x[2] / 5, x[3] / 10, x[4]])


@given(STATES)
def test_observations_are_clipped_to_their_bounds_and_otherwise_exact(
    state: np.ndarray,
) -> None:
    seen = observe(P, state)
    assert seen.dtype == np.float32
    assert np.all(np.abs(seen) <= OBSERVATION_BOUND)
    expected = np.clip(unbounded(state), -OBSERVATION_BOUND, OBSERVATION_BOUND)
    assert np.allclose(seen, expected, rtol=1e-6, atol=1e-6)


@given(st.lists(STATES, min_size=1, max_size=5))
def test_many_states_are_observed_like_each_alone(states: list[np.ndarray]) -> None:
    assert np.array_equal(observe(P, np.array(states)), [observe(P, x) for x in states])


def test_an_episode_that_exceeds_the_fastest_rate_ends_inside_the_observation_space() -> None:
    strong = P.replace(pendulum_length=0.0, pendulum_inertia=0.01, voltage_limit=400.0)
    env = RimlessWheelEnv(strong)
    env.reset(options={"state": [math.pi / 2, 0.0, 0.0, 0.0]})
    info: dict[str, Any] = {"failure": 0}
    while info["failure"] == 0:
        seen, _, _, _, info = env.step(np.ones(1, np.float32))
        assert env.observation_space.contains(seen)
    assert info["failure"] == Failure.RATE_EXCEEDED
    assert np.abs(env.state[2:4]).max() > MAX_RATE


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Task)])
@pytest.mark.parametrize(
    ("value", "error"),
    [(1e308, ValueError), (math.nan, ValueError), (-1, ValueError), ("1", TypeError)],
)
def test_invalid_prices_are_refused(name: str, value: Any, error: type) -> None:
    with pytest.raises(error, match=rf"{name} = .*must be"):
        Task(**{name: value})


def test_prices_can_be_numpy_numbers_and_become_floats() -> None:
    task = Task(distance_weight=np.float64(0.8), horizon=np.int64(30))
    assert task == Task(distance_weight=0.8, horizon=30.0)
    assert [type(value) for value in dataclasses.astuple(task)] == [float] * 5


def test_an_observation_does_not_share_memory_with_the_state() -> None:
    state = np.zeros(STATE_SIZE)
    state[0] = math.pi / 2
    seen = observe(P, state)
    state[:] = 1.0
    assert np.array_equal(seen, observe(P, np.array([math.pi / 2, 0, 0, 0, 0, 0])))
