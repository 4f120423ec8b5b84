"""What the doors accept and refuse: constructors, reset options, seeds, actions, specs."""

from __future__ import annotations

import dataclasses
import math
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from rimless_gym import (
    BUILDABLE,
    PROTOTYPE,
    THESIS_NOMINAL,
    THESIS_PHYSICAL,
    Disturbances,
    Pushes,
    Ranges,
    RimlessWheelEnv,
    RimlessWheelSpeedEnv,
    RimlessWheelSpeedVectorEnv,
    RimlessWheelVectorEnv,
    SensorNoise,
    Starts,
    Task,
    Terrain,
)
from rimless_gym.hybrid import MAX_RATE
from tests.rimless_gym.envs.rows import ID, SAME, make, swinging

UPHILL = {"slope": -0.01, "n_legs": 6}
ROUGH = Disturbances(
    pushes=Pushes(rate=np.float32(5), impulse=(0.1, 1.0)),
    sensor_noise=SensorNoise(leg_rate=0.1),
    actuator_delay=(np.int64(0), 2),
)
ARGUMENTS: dict[str, dict[str, Any]] = {
    "a machine's name": {"params": "PROTOTYPE"},
    "objects": {"params": PROTOTYPE, "task": Task(target_speed=0.4), "disturbances": ROUGH},
    "ranges": {"ranges": Ranges({"slope": (-0.02, 0.02)}), "params": THESIS_NOMINAL},
    "dictionaries": {
        "starts": {"whirling": 1},
        "disturbances": {"pushes": {"rate": 4, "impulse": [0, 1]}, "actuator_delay": [1, 2]},
    },
}
OF_VECTORS: dict[str, dict[str, Any]] = {
    "objects": ARGUMENTS["objects"],
    "a machine for each row": {"params": [PROTOTYPE, "THESIS_NOMINAL", UPHILL]},
    "numbers and modes": {"max_episode_steps": np.int64(15), "autoreset_mode": SAME},
    "no limit": {"max_episode_steps": None, "num_threads": 2},
}


def again(spec: EnvSpec | None) -> EnvSpec:
    assert spec is not None
    return EnvSpec.from_json(spec.to_json())


def goes_on_alike(envs: Any, twins: Any, actions: np.ndarray) -> None:
    assert type(twins.unwrapped) is type(envs.unwrapped)
    assert np.array_equal(envs.reset(seed=3)[0], twins.reset(seed=3)[0])
    for action in actions:
        one, other = envs.step(action)[:4], twins.step(action)[:4]
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
        if isinstance(one[2], bool) and (one[2] or one[3]):
            assert np.array_equal(envs.reset()[0], twins.reset()[0])


@pytest.mark.parametrize("arguments", ARGUMENTS.values(), ids=ARGUMENTS)
def test_an_environment_can_be_made_again_from_its_spec_as_text(arguments: dict) -> None:
    env = gym.make(ID, render_mode="rgb_array", max_episode_steps=20, **arguments)
    twin = gym.make(again(env.spec))
    assert twin.spec == again(twin.spec)
    assert twin.render_mode == "rgb_array"
    goes_on_alike(env, twin, swinging(1, 50)[:, 0])


@pytest.mark.parametrize("arguments", OF_VECTORS.values(), ids=OF_VECTORS)
def test_a_vector_environment_can_be_made_again_from_its_spec(arguments: dict) -> None:
    envs = gym.make_vec(ID, num_envs=3, **arguments)
    twins = gym.make_vec(again(envs.spec))
    assert twins.metadata == envs.metadata
    goes_on_alike(envs, twins, swinging(3, 30))


def test_machines_tasks_and_disturbances_can_be_given_by_name_or_by_fields() -> None:
    env = RimlessWheelEnv("PROTOTYPE", {"distance_weight": 0.8})
    assert env.params == PROTOTYPE
    assert env.task == Task(distance_weight=0.8)
    assert RimlessWheelEnv(UPHILL).params == BUILDABLE.replace(**UPHILL)
    env.reset(options={"params": {"drag": 0.1}})
    assert env.params == BUILDABLE.replace(drag=0.1)
    assert Disturbances(**ARGUMENTS["dictionaries"]["disturbances"]) == Disturbances(
        pushes=Pushes(rate=4.0, impulse=(0.0, 1.0)), actuator_delay=(1, 2)
    )


def test_numbers_may_be_numpys_and_lists_are_copied() -> None:
    task = Task(distance_weight=np.float64(0.8), horizon=np.int64(30))
    assert task == Task(distance_weight=0.8, horizon=30.0)
    assert [type(value) for value in dataclasses.astuple(task)] == [float] * 5
    delays = [1, 2]
    disturbances = Disturbances(actuator_delay=delays)
    delays[1] = 99
    assert hash(disturbances) == hash(Disturbances(actuator_delay=(1, 2)))
    envs = RimlessWheelVectorEnv(np.int64(2), num_threads=np.uint8(1), max_episode_steps=np.int8(3))
    assert [type(n) for n in (envs.num_envs, envs.max_episode_steps)] == [int, int]
    assert RimlessWheelVectorEnv(max_episode_steps=10**30).max_episode_steps == 10**30


@pytest.mark.parametrize(
    ("make_one", "arguments", "error", "message"),
    [
        (Task, {"slip_penalty": -1}, ValueError, "slip_penalty = -1.0: must be at least 0"),
        (Task, {"distance_weight": "1"}, TypeError, "distance_weight = '1': must be a real number"),
        (Task, {"target_speed": 1e31}, ValueError, "target_speed = .*: must be finite, and at"),
        (Starts, {"rest": 0, "moving": 0}, ValueError, "one of the shares must be greater than 0"),
        (Pushes, {"rate": 1.0, "impulse": (2, 1)}, ValueError, "impulse = .*: must be in order"),
        (Terrain, {"slope_std": 1.5}, ValueError, "slope_std = 1.5: .* 0.2 rad; give radians, not"),
        (Disturbances, {"sensor_noise": {"leg": 1}}, ValueError, "'leg' .*choose from .*leg_angle"),
        (Ranges, {"bounds": {"slope": (0.1, -0.1)}}, ValueError, "slope = .*: must be in order"),
    ],
)
def test_each_class_of_arguments_names_value_limit_and_remedy(
    make_one: Any, arguments: dict, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        make_one(**arguments)


@pytest.mark.parametrize("make_one", [RimlessWheelEnv, RimlessWheelVectorEnv])
@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"params": "CONCRETE"}, ValueError, "'CONCRETE': choose from BUILDABLE, .*PROTOTYPE"),
        ({"params": 3}, TypeError, "params = 3: give a WheelParams, a preset's name or a dict"),
        ({"ranges": {"armature_resistance": (1e-6, 5)}}, ValueError, "motor damps"),
        ({"disturbances": [1]}, TypeError, r"disturbances = \[1\]: give a rimless_gym.Dist"),
        ({"control_period": 0.015}, ValueError, "control_period = 0.015 s: .* from 0.01 to 0.1"),
        ({"actions": "torque"}, ValueError, r"actions = 'torque': choose from \('voltage', 'curr"),
        ({"render_mode": "ascii"}, ValueError, "render_mode = 'ascii': choose from"),
    ],
)
def test_an_environment_names_value_limit_and_remedy(
    make_one: Any, arguments: dict, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        make_one(**arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"num_envs": 0}, ValueError, "num_envs = 0: must be an integer of at least 1"),
        ({"max_episode_steps": math.nan}, TypeError, "max_episode_steps = nan: must be an integer"),
        ({"params": [PROTOTYPE] * 3, "num_envs": 2}, ValueError, "params: 3 for 2 rows"),
    ],
)
def test_a_vector_environment_names_value_limit_and_remedy(
    arguments: dict, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        RimlessWheelVectorEnv(**arguments)


def test_minus_one_is_no_limit_as_in_gym_make() -> None:
    assert make(1, max_episode_steps=-1).max_episode_steps is None


@pytest.mark.parametrize("make_one", [RimlessWheelSpeedEnv, RimlessWheelSpeedVectorEnv])
@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"speeds": (0.6, 0.3)}, ValueError, "must be in order"),
        ({"speeds": (0.3, 0.4, 0.5)}, ValueError, "give one number, or 2"),
        ({"task": {"target_speed": 0.5}}, ValueError, "the command takes its place"),
    ],
)
def test_an_environment_with_a_command_names_value_limit_and_remedy(
    make_one: Any, arguments: dict, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        make_one(**arguments)


STATE = {"state": [1.5, 0, 0, 0]}
OPTIONS = [
    ({"sate": [1.4, 0, 0, 0]}, ValueError, "unknown reset option 'sate'"),
    ({"state": [0.1, 0, 0, 0]}, ValueError, "phi = 0.1"),
    (
        {"params": THESIS_PHYSICAL, "state": [1.5, 3.0, 0, MAX_RATE]},
        ValueError,
        r"no voltage from -20 to 20 V .* largest force is -.* greater than 0: give a slower",
    ),
    ({"state": [1.5, -1e17, 0, 0]}, ValueError, r"theta = -1e\+17: .* modulo 2 pi"),
    ({"state": np.zeros((2, 4))}, ValueError, "state: 2 for . rows, must be one per row"),
    (STATE | {"mode": "flying"}, ValueError, "mode = 'flying'"),
    ({"mode": "single_stance"}, ValueError, "give 'double_stance'.*single_stance.*with a 'state'"),
    ({"params": [THESIS_PHYSICAL] * 2}, ValueError, "params: 2 for . rows"),
    ({"task": {"fall_penalty": -1.0}}, ValueError, "fall_penalty = -1.0: must be at least 0"),
]
SEEDS = [(2.5, TypeError), (True, TypeError), ("7", TypeError), (-1, ValueError)]
MASKS = [
    ({"reset_mask": [True, False, True]}, TypeError, "NumPy array of bool"),
    ({"reset_mask": np.array([True])}, ValueError, r"must have shape \(3,\)"),
    ({"reset_mask": np.zeros(3, bool)}, ValueError, "mark a row"),
    *(
        ({name: {}, "reset_mask": np.array([True, False, False])}, ValueError, "holds for all rows")
        for name in ("starts", "ranges", "disturbances")
    ),
]
ROW_SEEDS = [([5, -1, 7], ValueError), ([1, True, 3], TypeError), (np.ones(3), TypeError)]


@pytest.mark.parametrize("n", [None, 3], ids=["single", "rows"])
def test_refused_options_and_seeds_are_named_and_change_nothing(n: int | None) -> None:
    env: Any = RimlessWheelEnv() if n is None else make(n)
    env.reset(seed=0)
    before = pickle.dumps(env.get_state())
    good = {"params": "PROTOTYPE", "task": {"distance_weight": 9.0}, "starts": {"whirling": 1.0}}
    for nothing in (3, [], "mode"):
        with pytest.raises(TypeError, match=r"options = .*: must be a dictionary of options"):
            env.reset(options=nothing)
    for options, error, message in OPTIONS + (MASKS if n else []):
        kept = {} if "reset_mask" in options else good
        with pytest.raises(error, match=message):
            env.reset(seed=8, options=kept | options)
        assert pickle.dumps(env.get_state()) == before, options
    for seed, error in SEEDS + (ROW_SEEDS if n else []):
        with pytest.raises(error, match=r"seed = .*: must be an integer of at least 0"):
            env.reset(seed=seed, options=good)
        assert pickle.dumps(env.get_state()) == before, seed
    if n:
        with pytest.raises(ValueError, match="2 seeds for 3 rows"):
            env.reset(seed=[5, 6])
    assert env.np_random_seed == (0 if n is None else (0, 1, 2))


@pytest.mark.parametrize(
    ("action", "error"),
    [
        (None, TypeError),
        (np.array([0.5 + 0j]), TypeError),
        ([[0.5], [0.1, 0.2]], ValueError),
        (np.zeros(2, np.float32), ValueError),
        (np.array([math.nan], np.float32), ValueError),
    ],
)
def test_refused_actions_change_nothing(action: Any, error: type) -> None:
    env = RimlessWheelEnv()
    env.reset(seed=0)
    before = env.get_state()["batch"]["memory"]
    with pytest.raises(error, match=r"(?s)action = .*: must "):
        env.step(action)
    assert np.array_equal(env.get_state()["batch"]["memory"], before)


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (np.array([[np.nan], [0.0], [np.nan]], np.float32), ValueError, r"rows \[0, 2\] are NaN"),
        (np.zeros(3, np.float32), ValueError, r"must have shape \(3, 1\)"),
        ([[0.5], ["0.5"], [0.5]], TypeError, "must be real numbers"),
    ],
)
def test_refused_actions_of_rows_change_nothing(actions: Any, error: type, message: str) -> None:
    envs = make(3)
    envs.reset(seed=0)
    before = envs.get_state()["batch"]["memory"]
    with pytest.raises(error, match=rf"(?s)actions.*{message}"):
        envs.step(actions)
    assert np.array_equal(envs.get_state()["batch"]["memory"], before)


@pytest.mark.parametrize("make_one", [RimlessWheelSpeedEnv, RimlessWheelSpeedVectorEnv])
def test_refused_commands_and_targets_change_nothing(make_one: Any) -> None:
    env, target = make_one(), {"target_speed": 0.5}
    with pytest.raises(RuntimeError, match=r"no episode has begun: call reset\(\) first"):
        env.set_command(0.41)
    env.reset(seed=0, options={"speed": 0.41})
    before = pickle.dumps(env.get_state())
    for wrong, error in (
        (0.0, ValueError),
        (2.1, ValueError),
        (math.nan, ValueError),
        ("", TypeError),
    ):
        with pytest.raises(error, match=r"speed = .*must be"):
            env.set_command(wrong)
        with pytest.raises(error, match=r"speed = .*must be"):
            env.reset(seed=1, options={"speed": wrong, "params": "PROTOTYPE"})
    with pytest.raises(ValueError, match="choose commands by `speeds`"):
        env.set_task(target)
    with pytest.raises(ValueError, match="choose commands by `speeds`"):
        env.reset(options={"task": target, "params": "PROTOTYPE"})
    assert pickle.dumps(env.get_state()) == before
