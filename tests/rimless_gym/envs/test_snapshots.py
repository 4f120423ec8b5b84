"""Environments saved, restored, pickled and copied go on as if nothing had happened."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym import (
    PROTOTYPE,
    THESIS_PHYSICAL,
    Disturbances,
    Failure,
    Pushes,
    RimlessWheelVectorEnv,
    SensorNoise,
    Starts,
    Task,
)
from rimless_gym.envs.env import RimlessWheelEnv
from tests.rimless_gym.envs.rows import NEXT, ROUGH, SAME, make, swinging


@pytest.mark.parametrize("rough", [False, True])
def test_a_snapshot_a_pickle_and_a_copy_continue_identically(rough: bool) -> None:
    def future(env: Any) -> list[tuple]:
        rng, out = np.random.default_rng(1), []
        for i in range(250):
            if i % 20 == 0:
                action = np.sign(rng.uniform(-1, 1, 1)).astype(np.float32)
            seen, reward, terminated, truncated, info = env.step(action)
            out.append((seen.tobytes(), reward, terminated, truncated, info))
            if terminated or truncated:
                out.append((env.reset()[0].tobytes(),))
        return out

    disturbances = Disturbances(
        pushes=Pushes(rate=5.0, impulse=(0.1, 1.0)),
        sensor_noise=SensorNoise(leg_rate=0.1),
        actuator_delay=(0, 3),
    )
    settings = {"ranges": {"slope": (-0.02, 0.02)}, "disturbances": disturbances} if rough else {}
    env = gym.make("RimlessWheel-v0", **settings)
    env.reset(seed=0)
    for _ in range(17):
        env.step(np.full(1, 0.3, np.float32))
    core: Any = env.unwrapped
    model = core.model
    snapshot, twins = core.get_state(), [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
    expected = future(env)
    assert any(len(step) == 1 for step in expected)  # an episode ended
    for twin in twins:
        assert future(twin) == expected
        assert twin.unwrapped.model.params == model.params or rough
    other = RimlessWheelEnv(PROTOTYPE)
    for _ in range(2):  # a snapshot can be restored any number of times
        other.set_state(pickle.loads(pickle.dumps(snapshot)))
        assert other.params == model.params
        assert other.model.params == model.params
        assert future(other) == expected


def test_a_snapshot_brings_its_task_and_starts_with_it() -> None:
    env, other = RimlessWheelEnv(), RimlessWheelEnv(starts=Starts(rest=1.0, moving=0.0))
    env.reset(seed=0, options={"task": {"distance_weight": 1.0}, "starts": {"whirling": 3.0}})
    other.set_state(env.get_state())
    assert other.task == env.task == Task(distance_weight=1.0)
    for _ in range(30):
        assert np.array_equal(env.reset()[0], other.reset()[0])
        assert env.step(np.ones(1, np.float32))[1] == other.step(np.ones(1, np.float32))[1]


def test_an_ended_episode_stays_ended_in_its_snapshot() -> None:
    env, other = RimlessWheelEnv(), RimlessWheelEnv()
    env.reset(options={"state": [1.5, 1.5, 1.0, -14.0]})
    while not env.step(-np.ones(1, np.float32))[2]:
        pass
    other.set_state(env.get_state())
    with pytest.raises(RuntimeError, match="reset"):
        other.step(np.zeros(1, np.float32))


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_a_snapshot_a_pickle_and_a_copy_of_a_vector_environment_continue_identically(
    mode: AutoresetMode, settings: dict
) -> None:
    def future(envs: RimlessWheelVectorEnv) -> list[bytes]:
        steps = (envs.step(actions) for actions in swinging(5, 150, seed=1))
        return [part.tobytes() for step in steps for part in step[:4]]

    envs = make(5, mode, **settings, max_episode_steps=60)
    envs.reset(seed=0)
    for actions in swinging(5, 61):  # in mode NEXT some rows await their reset now
        envs.step(actions)
    snapshot, twins = envs.get_state(), [pickle.loads(pickle.dumps(envs)), copy.deepcopy(envs)]
    expected = future(envs)
    assert len(set(expected)) > 100
    for twin in twins:
        assert future(twin) == expected
    envs.set_state(snapshot)
    assert future(envs) == expected
    other = make(5, mode, max_episode_steps=60)  # with other parameters, not yet reset
    other.set_state(pickle.loads(pickle.dumps(snapshot)))
    assert future(other) == expected
    envs.set_state(snapshot)
    assert future(envs) == expected  # a snapshot can be restored any number of times


@pytest.mark.parametrize("new", [RimlessWheelEnv, lambda: make(3)], ids=["one", "rows"])
def test_a_snapshot_from_before_the_first_reset_can_be_restored(new: Callable[[], Any]) -> None:
    env, action = new(), np.zeros(new().action_space.shape, np.float32)
    blank = env.get_state()
    first = env.reset()[0]
    for other in (env, new()):
        other.set_state(blank)
        with pytest.raises(RuntimeError, match=r"no episode running|no episode is running"):
            other.step(action)
        assert np.array_equal(other.reset()[0], first)
        other.step(action)
    other.reset(seed=5)
    assert np.array_equal(other.reset(seed=0)[0], new().reset(seed=0)[0])


def changed(state: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    if name in state:
        return state | {name: value}
    return state | {"batch": state["batch"] | {name: value}}


def spoilt(state: dict[str, Any], name: str, wrong: float) -> dict[str, Any]:
    array = state["batch"][name].copy()
    array[(0,) * array.ndim] = wrong
    return changed(state, name, array)


SPOILT: list[tuple[Callable[[dict[str, Any]], Any], str]] = [
    (lambda state: 3, "state = 3: must have the parts"),
    (lambda state: changed(state, "batch", {"memory": 0}), r"batch.*what get_state\(\) of a"),
    (lambda state: changed(state, "params", []), "the state is of 0 rows, not of 1"),
    (lambda state: changed(state, "memory", np.zeros((3, 1))), "memory must be an array"),
    *(
        (lambda state, name=name: spoilt(state, name, math.nan), f"{name} must be finite")
        for name in ("memory", "held", "constants", "poles", "numbers")
    ),
    (lambda state: changed(state, "generators", [{}]), "generators: .*PCG64"),
]


@pytest.mark.parametrize("new", [RimlessWheelEnv, lambda: make(1)], ids=["one", "row"])
def test_invalid_snapshots_are_refused_and_change_nothing(new: Callable[[], Any]) -> None:
    env, other = new(), new()
    env.reset(seed=0)
    other.reset(seed=1, options={"params": PROTOTYPE, "ranges": {"slope": (0.0, 0.1)}})
    before = pickle.dumps(env.get_state())
    for spoil, message in SPOILT:
        with pytest.raises(ValueError, match=message):
            env.set_state(spoil(other.get_state()))
        assert pickle.dumps(env.get_state()) == before


def test_a_snapshot_can_be_restored_after_refused_actions_and_lost_motions() -> None:
    machines = [THESIS_PHYSICAL.replace(voltage_limit=1e7), PROTOTYPE]
    envs = make(3, params=[*machines, THESIS_PHYSICAL.replace(impact_law="thesis")])
    backward = {"state": [PROTOTYPE.constants.a + 0.001, 0.0, -1.0, 0.0]}
    envs.reset(seed=0, options=backward)
    before = pickle.dumps(envs.get_state())
    with pytest.raises(ValueError, match="NaN"):
        envs.step(np.array([[0.5], [math.nan], [0.5]], np.float32))
    assert pickle.dumps(envs.get_state()) == before
    reasons: set[int] = set()
    for actions in swinging(3, 50, hold=5):
        reasons |= set(envs.step(actions)[-1]["failure"].tolist())
        envs.set_state(envs.get_state())
    assert Failure.BACKWARD_TOUCHDOWN_UNDER_THE_THESIS_LAW in reasons
