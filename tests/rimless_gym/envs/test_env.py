"""The environment's contract."""

from __future__ import annotations

import copy
import json
import math
import pickle
import subprocess
import sys
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import rimless_gym
from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, Disturbances, Pushes, SensorNoise, Task
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.hybrid import MAX_RATE

P = THESIS_PHYSICAL.constants


@pytest.fixture
def env() -> gym.Env:
    return gym.make("RimlessWheel-v0")


def test_both_checkers_are_silent() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make("RimlessWheel-v0", render_mode="rgb_array").unwrapped)
        sb3_check_env(gym.make("RimlessWheel-v0"))
        checked = gym.make("RimlessWheel-v0", disable_env_checker=False)
        checked.reset(seed=0)
        checked.step(np.zeros(1, np.float32))


def test_the_environment_enforces_its_order_itself() -> None:
    env = gym.make("RimlessWheel-v0", render_mode="rgb_array")
    with pytest.raises(RuntimeError, match=r"no episode is running: call reset\(\) first"):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(RuntimeError, match=r"no episode has begun: call reset\(\) first"):
        env.render()
    env.reset(seed=0)
    env.step(np.zeros(1, np.float32))


def test_the_same_seed_and_actions_give_the_same_episode(env: gym.Env) -> None:
    def episode() -> list[np.ndarray]:
        rng = np.random.default_rng(0)
        seen = [env.reset(seed=3)[0]]
        for _ in range(200):
            observation, _, ended, _, _ = env.step(rng.uniform(-0.3, 0.3, 1).astype(np.float32))
            seen.append(observation)
            if ended:
                break
        return seen

    assert np.array_equal(episode(), episode())


def test_reward_terms_sum_to_the_reward_exactly_and_follow_the_definition(env: gym.Env) -> None:
    rng = np.random.default_rng(1)
    env.reset(seed=1)
    ends = 0
    for i in range(3000):
        if i % 25 == 0:  # held so long that the wheel falls now and then
            action = rng.uniform(-1, 1, 1).astype(np.float32)
        _, reward, ended, truncated, info = env.step(action)
        terms = info["reward_distance"], info["reward_energy"], info["reward_end"]
        assert reward == terms[0] + terms[1] + terms[2]
        assert terms[0] == 0.5 * info["distance"]
        assert terms[1] == -(info["electrical_positive"]) / THESIS_PHYSICAL.weight
        assert terms[2] == (-1.0 if ended else 0.0)
        if ended or truncated:
            ends += ended
            env.reset()
    assert ends


def test_no_observation_element_is_constant_and_all_stay_in_bounds(env: gym.Env) -> None:
    rng, seen = np.random.default_rng(2), []
    env.reset(seed=2)
    for _ in range(3000):
        observation, _, ended, truncated, _ = env.step(rng.uniform(-1, 1, 1).astype(np.float32))
        assert env.observation_space.contains(observation)
        seen.append(observation)
        if ended or truncated:
            seen.append(env.reset()[0])
    assert np.all(np.ptp(seen, axis=0) > 0.1)
    assert len({id(observation) for observation in seen}) == len(seen)


def test_starts_are_random_and_include_rest(env: gym.Env) -> None:
    modes = [env.reset(seed=seed)[1]["mode"] for seed in range(200)]
    assert 20 < modes.count("double_stance") < 80
    observations = [env.reset(seed=seed)[0] for seed in range(20)]
    assert len(np.unique(observations, axis=0)) == 20


def test_resting_is_legal_free_and_ends_only_by_truncation(env: gym.Env) -> None:
    env.reset(options={"state": [P.a, 0, 0, 0], "mode": "double_stance"})
    total = 0.0
    for _ in range(rimless_gym.EPISODE_STEPS):
        _, reward, terminated, truncated, info = env.step(np.zeros(1, np.float32))
        total += reward
        assert not terminated
        if truncated:
            break
    assert truncated
    assert total == 0.0
    assert info["mode"] == "double_stance"


def test_an_early_end_pays_less_than_resting_for_the_rest_of_the_episode() -> None:
    for idle_power in (0.0, 5.0):
        params = THESIS_PHYSICAL.replace(idle_power=idle_power)
        for task in (Task(), Task(value_of_distance=10.0), Task(horizon=100.0)):
            end = sum(task.reward_terms(params, 0.0, 0.0, 1.0))
            rest = sum(task.reward_terms(params, 0.0, idle_power * task.horizon, 0.0))
            assert end < rest


def test_a_lunge_that_ends_in_a_fall_does_not_pay() -> None:
    for value in (0.5, 10.0):
        env, rng = RimlessWheelEnv(task=Task(value_of_distance=value)), np.random.default_rng(0)
        for _ in range(40):
            env.reset(options={"mode": "double_stance"})
            total, ended, volts = 0.0, False, rng.uniform(-1, 1, 8)
            for i in range(200):
                _, reward, ended, _, _ = env.step(volts[i // 25 : i // 25 + 1])
                total += reward
                if ended:
                    break
            assert not ended or total < 0


def test_a_lost_contact_terminates_inside_the_step_and_says_so(env: gym.Env) -> None:
    env.reset(options={"state": [1.5, 1.5, 1.0, -14.0]})
    for _ in range(300):
        _, _, terminated, truncated, info = env.step(np.array([-1.0], np.float32))
        if terminated:
            break
    assert terminated
    assert not truncated
    assert info["failure"] in ("contact_lost", "rate_exceeded")
    assert info["elapsed"] <= 0.01
    with pytest.raises(RuntimeError, match="reset"):
        env.unwrapped.step(np.zeros(1, np.float32))


def test_actions_are_clipped_but_nan_and_wrong_shapes_raise() -> None:
    first, second = RimlessWheelEnv(), RimlessWheelEnv()
    for each in (first, second):
        each.reset(seed=0)
    over, _, _, _, _ = first.step(np.array([7.0], np.float32))
    limit, _, _, _, _ = second.step(np.array([1.0], np.float32))
    assert np.array_equal(over, limit)
    with pytest.raises(ValueError, match="NaN"):
        first.step(np.array([math.nan], np.float32))
    for action in (np.zeros(2, np.float32), np.zeros((1, 1), np.float32), 0.5):
        with pytest.raises(ValueError, match="shape"):
            first.step(action)
    assert np.array_equal(first.state, second.state)  # a refused action changes nothing


def test_reset_options_set_state_mode_and_params() -> None:
    env = RimlessWheelEnv()
    env.reset(options={"state": [1.4, 0.3, 1.0, 2.0], "params": PROTOTYPE})
    assert env.params == PROTOTYPE
    assert env.state[:4] == pytest.approx([1.4, 0.3, 1.0, 2.0])
    assert env.model.params == PROTOTYPE


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sate": [1.4, 0, 0, 0]}, "unknown reset option 'sate'"),
        ({"state": [0.1, 0, 0, 0]}, "phi = 0.1"),
        ({"state": [1.5, 3.0, 0, MAX_RATE]}, "pull"),
        ({"mode": "single_stance"}, "goes with 'state'"),
        ({"params": THESIS_PHYSICAL.replace(armature_resistance=1e-6)}, "motor damps"),
        ({"params": "PROTOTYPE"}, "WheelParams"),
    ],
)
def test_bad_reset_options_are_refused_by_name(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RimlessWheelEnv().reset(options=options)


def test_a_refused_reset_changes_nothing() -> None:
    env = RimlessWheelEnv()
    env.reset(seed=0)
    before = env.state
    with pytest.raises(ValueError, match="phi = 9"):
        env.reset(options={"params": PROTOTYPE, "state": [9, 9, 9, 9]})
    assert env.params == THESIS_PHYSICAL
    assert np.array_equal(env.state, before)


def test_double_stance_alone_is_a_wheel_at_rest() -> None:
    env = RimlessWheelEnv()
    observation, info = env.reset(options={"mode": "double_stance"})
    assert info["mode"] == "double_stance"
    assert np.array_equal(observation[1:], np.array([0, 1, 0, 0, 1], np.float32))


@pytest.mark.parametrize("limit", [1e3, 3e4, 1e6])
def test_absurd_voltages_end_the_episode_or_raise_but_never_give_nonsense(limit: float) -> None:
    env = RimlessWheelEnv(THESIS_PHYSICAL.replace(voltage_limit=limit))
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(500):
        try:
            observation, reward, ended, _, info = env.step(rng.uniform(-1, 1, 1))
        except RuntimeError:  # says that the motion diverged
            env.reset()
            continue
        assert np.all(np.isfinite(observation))
        assert math.isfinite(reward)
        spent = info["copper"] + info["collision"] + info["mechanical_change"]
        assert abs(info["electrical"] - spent) < 1e-7 * max(1.0, abs(info["electrical"]))
        if ended:
            env.reset()


@pytest.mark.parametrize("rough", [False, True])
def test_a_snapshot_a_pickle_and_a_copy_go_on_alike(rough: bool) -> None:
    def future(env: Any) -> list[tuple]:
        rng, out = np.random.default_rng(1), []
        for i in range(400):
            if i % 20 == 0:
                action = np.sign(rng.uniform(-1, 1, 1)).astype(np.float32)
            seen, reward, terminated, truncated, info = env.step(action)
            out.append((seen.tobytes(), reward, terminated, truncated, dict(info)))
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
    for _ in range(2):  # a snapshot can be taken up any number of times
        other.set_state(pickle.loads(pickle.dumps(snapshot)))
        assert other.params == model.params
        assert other.model.params == model.params
        assert future(other) == expected


def test_a_snapshot_of_another_task_is_refused() -> None:
    env = RimlessWheelEnv(task=Task(value_of_distance=1.0))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="value_of_distance"):
        RimlessWheelEnv().set_state(env.get_state())


def test_an_ended_episode_stays_ended_in_its_snapshot() -> None:
    env, other = RimlessWheelEnv(), RimlessWheelEnv()
    env.reset(options={"state": [1.5, 1.5, 1.0, -14.0]})
    while not env.step(-np.ones(1, np.float32))[2]:
        pass
    other.set_state(env.get_state())
    with pytest.raises(RuntimeError, match="reset"):
        other.step(np.zeros(1, np.float32))


def test_another_process_sees_the_same_episode() -> None:
    code = (
        "import gymnasium, numpy, rimless_gym;"
        "env = gymnasium.make('RimlessWheel-v0');"
        "seen = [env.reset(seed=4)[0]];"
        "seen += [env.step(numpy.full(1, 0.2, 'f4'))[0] for _ in range(50)];"
        "print(numpy.array(seen).tobytes().hex())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    env = gym.make("RimlessWheel-v0")
    seen = [env.reset(seed=4)[0]]
    seen += [env.step(np.full(1, 0.2, np.float32))[0] for _ in range(50)]
    assert done.stdout.strip() == np.array(seen).tobytes().hex()


def test_rewards_are_bounded(env: gym.Env) -> None:
    p, machine = P, THESIS_PHYSICAL
    speed = MAX_RATE * 10 * p.L1  # no step is trusted with more
    current = (machine.voltage_limit + p.K * 20 * MAX_RATE) / machine.armature_resistance
    step = 0.01 * (0.5 * speed + machine.voltage_limit * current / machine.weight)
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    for i in range(3000):
        if i % 20 == 0:
            action = np.sign(rng.uniform(-1, 1, 1)).astype(np.float32)
        _, reward, terminated, truncated, _ = env.step(action)
        assert abs(reward) < step + 1.0
        if terminated or truncated:
            env.reset()


def test_info_is_a_dictionary_whichever_way_it_is_read_first() -> None:
    env, twin = RimlessWheelEnv(), RimlessWheelEnv()
    for each in (env, twin):
        each.reset(seed=0)
    whole = dict(twin.step(np.ones(1, np.float32))[-1])
    state = env.get_state()

    def fresh() -> dict:
        env.set_state(state)
        return env.step(np.ones(1, np.float32))[-1]

    assert len(whole) > 20
    assert type(whole) is dict
    assert isinstance(fresh(), dict)
    assert fresh() == whole
    assert whole == fresh()
    assert not fresh() != whole  # noqa: SIM202  an operator of its own
    assert {**fresh()} == whole
    assert dict(**fresh()) == whole
    assert (fresh() | {"more": 1}) == (whole | {"more": 1})
    assert ({"more": 1} | fresh()) == ({"more": 1} | whole)
    for way in (copy.copy, copy.deepcopy, dict.fromkeys, list, set, len, repr, bool, sorted):
        assert way(fresh()) == way(whole)
    assert json.loads(json.dumps(fresh())) == json.loads(json.dumps(whole))
    assert json.dumps(fresh(), indent=1, sort_keys=True) == json.dumps(
        whole, indent=1, sort_keys=True
    )
    assert type(fresh())(fresh()) == whole
    assert pickle.loads(pickle.dumps(fresh())) == whole
    assert type(pickle.loads(pickle.dumps(fresh()))) is dict
    assert list(reversed(fresh())) == list(reversed(whole))
    for method in ("keys", "values", "items"):
        assert list(getattr(fresh(), method)()) == list(getattr(whole, method)())
    assert fresh().copy() == whole
    for name, value in whole.items():
        assert fresh()[name] == value
        assert fresh().get(name) == value
        assert fresh().pop(name) == value
        assert fresh().setdefault(name, "other") == value
        assert name in fresh()
        info = fresh()
        info[name] = "mine"  # what is written stays
        assert info[name] == "mine"
        assert len(info) == len(whole)
        assert info == whole | {name: "mine"}
        info = fresh()
        del info[name]
        assert name not in info
        assert len(info) == len(whole) - 1
    info = fresh()
    info.update(distance=3, other=4)
    assert info == whole | {"distance": 3, "other": 4}
    info = fresh()
    info |= {"distance": 3}
    assert info == whole | {"distance": 3}
    assert "nothing" not in fresh()
    assert fresh().get("nothing") is None
    assert fresh().get("nothing", 1) == 1
    with pytest.raises(KeyError, match="nothing"):
        fresh()["nothing"]
    info = fresh()
    info.clear()
    assert info == {}
    older = fresh()
    env.step(-np.ones(1, np.float32))
    assert older == whole  # a later step leaves it alone


def test_stepping_before_reset_says_what_to_do() -> None:
    with pytest.raises(RuntimeError, match="reset"):
        RimlessWheelEnv().step(np.zeros(1, np.float32))


def test_frames_are_drawn_without_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    env = gym.make("RimlessWheel-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(10):
        env.step(np.ones(1, np.float32))
    second = env.render()
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    assert not np.array_equal(first, second)
