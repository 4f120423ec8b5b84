"""Arguments as text: names, dictionaries, and specs from which to make an environment again."""

from __future__ import annotations

import json
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from rimless_gym import (
    BUILDABLE,
    PROTOTYPE,
    THESIS_NOMINAL,
    Disturbances,
    Pushes,
    Ranges,
    SensorNoise,
    Task,
)
from rimless_gym.envs.env import RimlessWheelEnv
from tests.rimless_gym.envs.rows import SAME, swinging

ID = "RimlessWheel-v0"
UPHILL = {"slope": -0.01, "n_legs": 6}
ROUGH = Disturbances(
    pushes=Pushes(rate=np.float32(5), impulse=(0.1, 1.0)),
    sensor_noise=SensorNoise(leg_rate=0.1),
    actuator_delay=(np.int64(0), 2),
)
ARGUMENTS: dict[str, dict[str, Any]] = {
    "none": {},
    "a machine's name": {"params": "PROTOTYPE"},
    "some of its fields": {"params": UPHILL, "task": {"distance_weight": 0.8}},
    "objects": {"params": PROTOTYPE, "task": Task(fall_penalty=3.0), "disturbances": ROUGH},
    "drawn machines": {"ranges": {"slope": (-0.02, 0.02)}, "disturbances": ROUGH},
    "ranges as an object": {"ranges": Ranges({"slope": (-0.02, 0.02)}), "params": THESIS_NOMINAL},
    "dictionaries": {
        "disturbances": {
            "pushes": {"rate": 4, "impulse": [0, 1]},
            "sensor_noise": {"leg_angle": 0.01},
            "actuator_delay": [1, 2],
        }
    },
}
OF_VECTORS: dict[str, dict[str, Any]] = {
    "a machine for each row": {"params": [PROTOTYPE, "THESIS_NOMINAL", UPHILL]},
    "numbers and modes": {"max_episode_steps": np.int64(15), "autoreset_mode": SAME},
    "numpy's numbers": {"ranges": {"slope": np.array([-0.02, 0.02], np.float32)}},
    "no limit": {"max_episode_steps": None, "num_threads": 2},
}


def again(spec: EnvSpec | None) -> EnvSpec:
    assert spec is not None
    return EnvSpec.from_json(spec.to_json())


def same(parts: tuple, others: tuple) -> bool:
    return all(np.array_equal(one, other) for one, other in zip(parts[:4], others[:4], strict=True))


@pytest.mark.parametrize("arguments", ARGUMENTS.values(), ids=ARGUMENTS)
def test_an_environment_can_be_made_again_from_its_spec_as_text(arguments: dict) -> None:
    env = gym.make(ID, render_mode="rgb_array", max_episode_steps=20, **arguments)
    twin = gym.make(again(env.spec))
    assert twin.spec == again(twin.spec)
    assert twin.render_mode == "rgb_array"
    assert np.array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    for action in swinging(1, 60)[:, 0]:
        one = env.step(action)
        assert same(one, twin.step(action))
        if one[2] or one[3]:
            assert np.array_equal(env.reset()[0], twin.reset()[0])


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
@pytest.mark.parametrize("arguments", ARGUMENTS.values(), ids=ARGUMENTS)
def test_a_vector_environment_can_be_made_again_from_its_spec(arguments: dict, mode: str) -> None:
    goes_on_alike(gym.make_vec(ID, num_envs=3, vectorization_mode=mode, **arguments))


@pytest.mark.parametrize("arguments", OF_VECTORS.values(), ids=OF_VECTORS)
def test_arguments_only_of_vector_environments_are_in_their_spec_too(arguments: dict) -> None:
    goes_on_alike(gym.make_vec(ID, num_envs=3, **arguments))


def goes_on_alike(envs: gym.vector.VectorEnv) -> None:
    twins = gym.make_vec(again(envs.spec))
    assert type(twins.unwrapped) is type(envs.unwrapped)
    assert twins.metadata == envs.metadata
    assert np.array_equal(envs.reset(seed=3)[0], twins.reset(seed=3)[0])
    for actions in swinging(3, 40):
        assert same(envs.step(actions), twins.step(actions))


def test_a_spec_holds_only_plain_values() -> None:
    env = gym.make(ID, params=PROTOTYPE, disturbances=ROUGH)
    assert env.spec is not None
    assert env.spec.kwargs == json.loads(json.dumps(env.spec.kwargs))
    assert env.spec.kwargs["params"] == PROTOTYPE.to_dict()
    assert RimlessWheelEnv().spec is None


def test_machines_and_tasks_can_be_given_by_name_or_by_fields() -> None:
    env = RimlessWheelEnv("PROTOTYPE", {"distance_weight": 0.8})
    assert env.params == PROTOTYPE
    assert env.task == Task(distance_weight=0.8)
    assert RimlessWheelEnv(UPHILL).params == BUILDABLE.replace(**UPHILL)
    env.reset(options={"params": {"drag": 0.1}})
    assert env.params == BUILDABLE.replace(drag=0.1)
    disturbances = ARGUMENTS["dictionaries"]["disturbances"]
    assert Disturbances(**disturbances) == Disturbances(
        pushes=Pushes(rate=4.0, impulse=(0.0, 1.0)),
        sensor_noise=SensorNoise(leg_angle=0.01),
        actuator_delay=(1, 2),
    )


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"params": "CONCRETE"}, ValueError, "'CONCRETE': choose from BUILDABLE, .*PROTOTYPE"),
        ({"params": {"leg_lenght": 1}}, ValueError, "'leg_lenght' .*choose from .*'leg_length'"),
        ({"params": {3: 1}}, ValueError, "'3' is not a field of WheelParams: choose from"),
        ({"params": {"drag": -1}}, ValueError, "drag = -1.0: must be at least 0"),
        ({"params": 3}, TypeError, "params = 3: give a WheelParams, a preset's name or a dict"),
        ({"params": [PROTOTYPE]}, TypeError, "give a WheelParams"),
        ({"task": {"value": 1}}, ValueError, "task: 'value' .*choose from .*'distance_weight'"),
        ({"task": {"horizon": -1}}, ValueError, "horizon = -1"),
        ({"task": "walk"}, TypeError, "task = 'walk': give a rimless_gym.Task or a dictionary"),
        ({"ranges": "slope"}, TypeError, "ranges = 'slope': give a mapping"),
        ({"ranges": {"sloop": (0, 1)}}, ValueError, "'sloop' cannot be drawn: choose from .*slope"),
        ({"disturbances": {"push": 1}}, ValueError, "'push' .*choose from .*'pushes'"),
        ({"disturbances": {"pushes": {"rate": 1}}}, TypeError, "pushes: give its impulse as well"),
        (
            {"disturbances": {"sensor_noise": {"leg": 1}}},
            ValueError,
            "sensor_noise: 'leg' .*choose from .*'leg_angle'",
        ),
        ({"disturbances": [1]}, TypeError, r"disturbances = \[1\]: give a rimless_gym.Dist"),
    ],
)
def test_unknown_names_and_wrong_types_are_refused_with_the_choices(
    arguments: dict, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        RimlessWheelEnv(**arguments)
    with pytest.raises(error, match=message):
        gym.make(ID, **arguments)
