"""Gymnasium's contract of the single environments: observations, actions, ends, info, pictures."""

from __future__ import annotations

import math
import warnings
from typing import Any

import gymnasium as gym
import hypothesis
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.play import play
from hypothesis import given
from hypothesis import strategies as st

from rimless_gym import THESIS_PHYSICAL, RimlessWheelVectorEnv
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.layout import INFO_NAMES, OBSERVATION_BOUND, observe
from rimless_gym.equations import DOUBLE, LOSSES, SINGLE
from rimless_gym.hybrid import MAX_RATE, Failure
from rimless_gym.rendering.canvas import pygame
from tests.rimless_gym.envs.rows import ID, ROUGH, SPEED_ID, STILL, make, swinging

P = THESIS_PHYSICAL
ANY = st.floats(-1e4, 1e4)
STATES = st.tuples(ANY, ANY, ANY, ANY, st.sampled_from([0.0, 1.0]), st.just(0.0)).map(np.array)


@pytest.mark.parametrize("id", [ID, SPEED_ID])
def test_gymnasiums_checker_is_silent(id: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(id, render_mode="rgb_array").unwrapped)
        checked = gym.make(id, disable_env_checker=False)
        checked.reset(seed=0)
        checked.step(STILL)


def test_the_environment_itself_enforces_the_order_of_calls() -> None:
    env = gym.make(ID, render_mode="rgb_array")
    with pytest.raises(RuntimeError, match=r"no episode is running: call reset\(\) first"):
        env.step(STILL)
    with pytest.raises(RuntimeError, match=r"no episode has begun: call reset\(\) first"):
        env.render()
    env.reset(seed=0)
    env.step(STILL)


def test_no_observation_element_is_constant_and_all_stay_in_bounds() -> None:
    env, rng, seen = gym.make(ID), np.random.default_rng(2), []
    env.reset(seed=2)
    for _ in range(1000):
        observation, _, ended, truncated, _ = env.step(rng.uniform(-1, 1, 1).astype(np.float32))
        seen.append(observation)
        if ended or truncated:
            seen.append(env.reset()[0])
    assert (np.abs(seen) <= env.observation_space.high).all()
    assert np.all(np.ptp(seen, axis=0) > 0.1)
    assert len({id(observation) for observation in seen}) == len(seen)


def unbounded(x: np.ndarray) -> np.ndarray:
    leg = (x[0] - math.pi / 2) / (P.leg_angle / 2)
    return np.array([leg, math.sin(x[1]), math.cos(x[1]), x[2] / 5, x[3] / 10, x[4]])


@hypothesis.settings(max_examples=50)
@given(st.lists(STATES, min_size=1, max_size=5))
def test_observations_are_clipped_to_their_bounds_and_otherwise_exact(states: list) -> None:
    seen = observe(P, np.array(states))
    assert seen.dtype == np.float32
    assert np.all(np.abs(seen) <= OBSERVATION_BOUND)
    expected = np.clip([unbounded(x) for x in states], -OBSERVATION_BOUND, OBSERVATION_BOUND)
    assert np.allclose(seen, expected, rtol=1e-6, atol=1e-6)
    assert np.array_equal(seen, [observe(P, x) for x in states])


def test_losing_contact_ends_the_episode_within_the_step_and_info_gives_the_reason() -> None:
    env = gym.make(ID)
    env.reset(options={"state": [1.5, 1.5, 1.0, -14.0]})
    terminated = False
    while not terminated:
        _, _, terminated, truncated, info = env.step(np.array([-1.0], np.float32))
    assert not truncated
    assert Failure(info["failure"]) is Failure.CONTACT_LOST
    assert env.unwrapped.measurements["elapsed"] <= 0.01
    with pytest.raises(RuntimeError, match="reset"):
        env.unwrapped.step(STILL)


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


@pytest.mark.parametrize("limit", [1e3, 1e6])
def test_absurd_voltages_end_the_episode_but_never_give_nonsense(limit: float) -> None:
    env = RimlessWheelEnv(P.replace(voltage_limit=limit))
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(300):
        observation, reward, ended, _, _ = env.step(rng.uniform(-1, 1, 1))
        energy = env.measurements
        assert np.all(np.isfinite(observation))
        assert math.isfinite(reward)
        spent = energy["copper"] + energy["collision"] + energy["mechanical_change"]
        assert abs(energy["electrical"] - spent) < 1e-7 * max(1.0, abs(energy["electrical"]))
        if ended:
            env.reset()


@pytest.mark.parametrize(
    "one",
    [[1], [True], np.array([1]), np.array([True]), (np.float32(1),), np.ones(1, np.longdouble)],
    ids=repr,
)
def test_actions_may_be_real_numbers_of_any_type_and_are_clipped(one: Any) -> None:
    def stepped(action: Any) -> np.ndarray:
        env = RimlessWheelEnv()
        env.reset(seed=0)
        return env.step(action)[0]

    expected = stepped(np.ones(1, np.float32))
    assert np.array_equal(stepped(one), expected)
    assert np.array_equal(stepped(one[0]), expected)
    assert np.array_equal(stepped(np.array([7.0], np.float32)), expected)
    many = RimlessWheelVectorEnv(2)
    many.reset(seed=0)
    assert np.array_equal(many.step([one, one])[0][0], expected)


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
def test_every_reset_and_step_has_the_same_entries_each_of_one_type(settings: dict) -> None:
    env, kinds, failures = gym.make(ID, **settings), set(), set()
    core: Any = env.unwrapped

    def see(info: dict[str, Any]) -> None:
        measured = core.measurements
        assert type(info) is dict
        assert tuple(info) == INFO_NAMES
        assert info == {name: measured[name] for name in info}
        kinds.add(tuple(sorted((name, type(value)) for name, value in measured.items())))

    see(env.reset(seed=0)[1])
    for action in swinging(1, 1000)[:, 0]:
        *_, terminated, truncated, info = env.step(action)
        see(info)
        failures.add(info["failure"])
        assert bool(info["failure"]) == terminated
        if terminated or truncated:
            see(env.reset()[1])
    assert len(kinds) == 1
    assert {kind for _, kind in kinds.pop()} == {float, int, bool}
    assert failures >= {Failure.NONE, Failure.CONTACT_LOST}


def test_after_a_reset_every_measurement_is_0_except_the_mode() -> None:
    env, envs = RimlessWheelEnv(), make(2)
    for each in (env, envs):
        each.reset(seed=0)
        each.step(np.ones(each.action_space.shape, np.float32))
    for options, mode in (
        ({"mode": "double_stance"}, DOUBLE),
        ({"state": [1.5, 0.0, 1.0, 0.0]}, SINGLE),
    ):
        for info in (env.reset(options=options)[1], env.measurements):
            assert info.pop("mode") == mode
            assert not any(info.values())
        _, info = envs.reset(options=options)
        assert info.pop("mode").tolist() == [mode, mode]
        assert not any(values.any() for values in info.values())


def test_slow_rocking_ends_in_rest_and_balances_alone_and_in_rows() -> None:
    light = P.replace(
        leg_length=0.07, n_legs=4, pendulum_mass=0.3, wheel_inertia=0.001, impact_law="relabel"
    )
    start = {"state": [light.constants.a, 0.01, 5e-3, 0.05]}
    env, envs = RimlessWheelEnv(light), make(3)
    env.reset(options=start)
    states = [[P.constants.a, 0.0, 0.5, 0.0]] * 3
    states[1] = start["state"]
    envs.reset(seed=0, options={"params": [P, light, P], "state": states})
    touchdowns = 0
    for _ in range(20):
        seen, _, ended, _, info = env.step(STILL)
        rows = envs.step(np.zeros((3, 1), np.float32))
        assert not ended
        assert np.array_equal(rows[0][1], seen)
        energy = env.measurements
        spent = sum(energy[name] for name in (*LOSSES, "collision", "mechanical_change"))
        assert energy["electrical"] == pytest.approx(spent, abs=1e-12)
        touchdowns += energy["touchdowns"]
    assert touchdowns > 10
    assert info["mode"] == rows[-1]["mode"][1] == DOUBLE


def test_the_arrow_keys_set_the_voltage_and_no_key_means_zero(monkeypatch: Any) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pressed = [
        (pygame.KEYDOWN, pygame.K_RIGHT, 1.0),
        (pygame.KEYDOWN, pygame.K_DOWN, 0.5),
        (pygame.KEYUP, pygame.K_DOWN, 1.0),
        (pygame.KEYUP, pygame.K_RIGHT, 0.0),
        (pygame.KEYDOWN, pygame.K_LEFT, -1.0),
        (pygame.KEYDOWN, pygame.K_DOWN, -0.5),
    ]
    taken = []

    def press(before: Any, after: Any, action: Any, *rest: Any) -> None:
        taken.append(float(np.ravel(action)[0]))  # 0 where no key is pressed
        if len(taken) <= len(pressed):
            kind, key, _ = pressed[len(taken) - 1]
            pygame.event.post(pygame.event.Event(kind, key=key))
        else:
            pygame.event.post(pygame.event.Event(pygame.QUIT))

    play(gym.make(ID, render_mode="rgb_array"), seed=0, fps=1000, callback=press)
    pygame.display.quit()
    assert taken == [0.0, *(volts for *_, volts in pressed)]
