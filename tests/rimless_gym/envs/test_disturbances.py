"""Pushes, sensor noise, actuator delay and drawn machines: what they change and what not."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import (
    BUILDABLE,
    PROTOTYPE,
    THESIS_PHYSICAL,
    Disturbances,
    Pushes,
    SensorNoise,
    Task,
    WheelParams,
)
from rimless_gym.envs.arguments import EpisodeStart
from rimless_gym.envs.batch import Batch
from rimless_gym.envs.disturbances import disturb_rows
from rimless_gym.envs.layout import MEMORY, OBSERVATION_SIZE
from rimless_gym.envs.starts import GIVEN, HANGING
from rimless_gym.equations import LOSSES, equations
from rimless_gym.export import joint_state
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import DPHI, DTHETA, FOOT, MODE, PHI, THETA
from rimless_gym.rules import LIMIT_TOLERANCE
from tests.rimless_gym.envs import rows

number = equations(math.sin, math.cos)
MACHINES = {
    "BUILDABLE": BUILDABLE,
    "THESIS_PHYSICAL": THESIS_PHYSICAL,
    "PROTOTYPE with a rotor": PROTOTYPE.replace(rotor_inertia=3e-7),
    "frame mount": THESIS_PHYSICAL.replace(motor_mount="frame", rotor_inertia=3e-7),
}
ALWAYS = 1e9  # pushes per second: one in every interval
DEMANDS, LIMIT = ("friction_demand", "impulse_friction_demand"), 1 + LIMIT_TOLERANCE


def make(**settings: Any) -> Any:
    return gym.make("RimlessWheel-v0", **settings).unwrapped


def swinging(steps: int, seed: int = 0) -> np.ndarray:
    """Random actions (steps, 1), each held for 0.2 s."""
    return rows.swinging(1, steps, seed)[:, 0] / 1.2


def pushed(params: WheelParams, impulse: float, kind: int, given: list[float]) -> Batch:
    """64 rows that started in the same state and were pushed, each in a random direction."""
    pushes = Pushes(rate=ALWAYS, impulse=(impulse, impulse))
    batch = Batch([params] * 64, Task(), disturbances=Disturbances(pushes=pushes))
    each, seen = np.arange(64), np.empty(64 * OBSERVATION_SIZE, np.float32)
    batch.begin(each, each.astype(np.uint64), seen, EpisodeStart(kind, np.array([given] * 64)))
    settings = batch.disturbances.settings(CONTROL_PERIOD)
    disturb_rows(batch.memory, batch.constants, batch.streams, batch.held, settings, 0, 64)
    return batch


@pytest.mark.parametrize("params", MACHINES.values(), ids=MACHINES)
def test_a_push_changes_the_rates_as_in_mujoco_with_the_foot_pinned(params, free_wheel):
    rng, p = np.random.default_rng(0), params.constants
    x = rng.uniform([p.a, -7, -6, -12], [p.b, 7, 6, 12], (200, 4))
    impulses = rng.uniform(-2, 2, (200, 2))
    q, v = joint_state(params, x)
    free = free_wheel(params).stack(q, v, np.zeros(200))
    angles = np.array([[1, 0], [p.d1, 1]])
    for state, inertia, jacobian, j in zip(x, free.inertia, free.jacobian, impulses, strict=True):
        shapes = np.vstack([-jacobian[:, 2:] @ angles, angles])  # joint rates that hold the foot
        jump = np.linalg.solve(shapes.T @ inertia @ shapes, shapes[:2].T @ j)
        assert number.push(*state, *j, p) == pytest.approx(state[2:] + jump, rel=1e-9, abs=1e-12)


def test_the_work_of_a_push_is_its_impulse_times_the_mean_hub_speed():
    p, start = THESIS_PHYSICAL.constants, [1.3, 0.7, 1.1, -2.0, 0]
    batch = pushed(THESIS_PHYSICAL, 0.8, GIVEN, start)
    ways = batch.memory[DPHI] > start[2]
    assert 16 < ways.sum() < 48
    speeds = p.L1 * math.sin(start[0]) * (start[2] + batch.memory[DPHI]) / 2
    assert batch.memory[MEMORY.push_work] == pytest.approx(
        np.where(ways, 0.8, -0.8) * speeds, rel=1e-9
    )
    assert not batch.memory[MEMORY.push_shift].any()
    assert np.all(batch.memory[[PHI, THETA]] == np.array([start[:2]]).T)


def test_a_push_tips_a_wheel_at_rest_over_the_foot_it_is_pushed_towards():
    batch, p = pushed(THESIS_PHYSICAL, 0.8, HANGING, [0.0] * 5), THESIS_PHYSICAL.constants
    forward = batch.memory[FOOT] == 0
    assert 16 < forward.sum() < 48
    for ways, phi, foot, j in ((forward, p.a, 0, 0.8), (~forward, p.b, -1, -0.8)):
        expected = number.push(phi, 0.0, 0.0, 0.0, j, 0.0, p)
        for row, value in ((PHI, phi), (FOOT, foot), (MODE, 0), (MEMORY.push_shift, foot)):
            assert np.all(batch.memory[row, ways] == value)
        assert batch.memory[DPHI, ways] == pytest.approx(expected[0], rel=1e-12)
        assert batch.memory[DTHETA, ways] == pytest.approx(expected[1], rel=1e-12)
        assert np.sign(batch.memory[DPHI, ways]).sum() == np.sign(j) * ways.sum()
    assert np.all(batch.memory[MEMORY.push_work] > 0)


def test_the_ledger_of_a_pushed_episode_balances_and_counts_its_steps():
    env = make(disturbances=Disturbances(pushes=Pushes(rate=20.0, impulse=(0.2, 1.0))))
    for seed in range(3):
        env.reset(seed=seed, options={"mode": "double_stance"})
        start, feet, work, blows, total = env.model.mechanical_energy, 0.0, 0.0, 0, 0.0
        before = float(start(env.state[:4]))
        for action in swinging(200, seed):
            _, _, terminated, _, _ = env.step(0.2 * action)
            info = env.measurements
            spent = sum(info[name] for name in (*LOSSES, "collision"))
            given = info["electrical"] + info["push"]
            assert given == pytest.approx(spent + info["mechanical_change"], abs=1e-9)
            feet, work = feet + info["steps"], work + info["push"]
            blows, total = blows + (info["push"] != 0.0), total + info["mechanical_change"]
            if terminated:
                break
        assert feet == env.state[FOOT]
        assert total == pytest.approx(float(start(env.state[:4])) - before, abs=1e-8)
        assert blows
        assert work


def test_pushes_have_the_requested_rate_and_size():
    pushes = Pushes(rate=20.0, impulse=(0.3, 0.5))
    envs = gym.make_vec(
        "RimlessWheel-v0", num_envs=2000, disturbances=Disturbances(pushes=pushes)
    ).unwrapped
    envs.reset(seed=0, options={"state": [math.pi / 2, 0.0, 0.0, 0.0]})
    still = np.zeros((2000, 1), np.float32)
    info = envs.step(still)[-1]
    share = np.count_nonzero(info["push"]) / 2000
    assert share == pytest.approx(1 - math.exp(-0.2), abs=0.03)
    p = envs.params[0].constants
    unit = number.push(math.pi / 2, 0.0, 0.0, 0.0, 1.0, 0.0, p)
    per_square = number.kinetic_energy(math.pi / 2, 0.0, *unit, p)
    sizes = np.sqrt(info["push"][info["push"] > 0] / per_square)  # from rest, work ~ impulse^2
    assert 0.3 <= sizes.min() < 0.31
    assert 0.49 < sizes.max() <= 0.5
    assert np.mean(sizes) == pytest.approx(0.4, abs=0.02)


def test_sensor_noise_has_the_requested_size_and_does_not_change_the_motion():
    noise = SensorNoise(leg_angle=0.01, pendulum_angle=0.05, leg_rate=0.2, pendulum_rate=0.4)
    exact, noisy = make(), make(disturbances=Disturbances(sensor_noise=noise))
    errors = []
    for seed in range(6):
        seen = exact.reset(seed=seed)[0], noisy.reset(seed=seed)[0]
        for action in swinging(150, seed):
            angles = [math.atan2(each[1], each[2]) for each in seen]
            turned = math.remainder(angles[1] - angles[0], 2 * math.pi)
            rates = (seen[1] - seen[0])[3:5] * [5.0, 10.0]
            if max(abs(each[0]) for each in seen) < 1.0:  # beyond it the leg's angle is clipped
                leg = float(seen[1][0] - seen[0][0]) * exact.params.leg_angle / 2
                errors.append((leg, turned, *rates))
            assert noisy.observation_space.contains(seen[1])
            assert seen[0][5] == seen[1][5]
            results = exact.step(action), noisy.step(action)
            assert results[0][1:4] == results[1][1:4]
            assert exact.measurements == noisy.measurements
            seen = results[0][0], results[1][0]
            if results[0][2]:
                break
        assert np.array_equal(exact.state, noisy.state)
    scales = 0.01, 0.05, 0.2, 0.4
    assert np.std(errors, axis=0) == pytest.approx(scales, rel=0.15)
    assert np.all(np.abs(np.mean(errors, axis=0)) < np.array(scales) / 6)
    assert np.abs(np.corrcoef(np.array(errors).T) - np.eye(4)).max() < 0.15


@pytest.mark.parametrize("delay", [1, 7])
def test_a_delayed_action_takes_effect_that_many_intervals_later(delay: int):
    late, prompt = make(disturbances=Disturbances(actuator_delay=delay)), make()
    for seed in range(3):
        late.reset(seed=seed)
        prompt.reset(seed=seed)
        commands = 0.3 * swinging(60, seed)
        shifted = np.concatenate([np.zeros((delay, 1), np.float32), commands])
        for given, acting in zip(commands, shifted, strict=False):
            assert np.array_equal(late.step(given)[0], prompt.step(acting)[0])
        assert np.array_equal(late.state, prompt.state)


def test_delays_are_drawn_for_each_episode():
    env = make(disturbances=Disturbances(actuator_delay=(1, 3)))
    delays = []
    for seed in range(60):
        env.reset(seed=seed, options={"mode": "double_stance"})
        drawn = [env.step(np.ones(1, np.float32))[-1]["electrical_positive"] != 0 for _ in range(5)]
        delays.append(drawn.index(True))
    assert {delay: delays.count(delay) > 8 for delay in set(delays)} == {1: True, 2: True, 3: True}


def test_each_episode_draws_a_machine_from_the_whole_range():
    ranges = {"slope": (-0.02, 0.01), "leg_length": (0.36, 0.4), "voltage_limit": (18.0, 18.0)}
    envs, drawn = rows.make(100, rows.SAME, ranges=ranges, max_episode_steps=1), []
    envs.reset(seed=0)
    for _ in range(4):
        drawn += envs.params
        envs.step(np.zeros((100, 1), np.float32))
    assert {machine.voltage_limit for machine in drawn} == {18.0}
    for name, (low, high) in list(ranges.items())[:2]:
        values = np.array([getattr(machine, name) for machine in drawn])
        assert len(np.unique(values)) == 400
        assert low <= values.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < values.max() < high
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=0.05 * (high - low))
    assert {machine.replace(**ranges_of(BUILDABLE, ranges)) for machine in drawn} == {BUILDABLE}


def ranges_of(params: WheelParams, names: Any) -> dict[str, float]:
    return {name: getattr(params, name) for name in names}


def test_a_drawn_machine_moves_and_pays_like_the_same_machine_given():
    ranges = {
        "slope": (-0.02, 0.02),
        "pendulum_mass": (2.0, 2.4),
        "idle_power": (0.0, 5.0),
        "voltage_limit": (15.0, 20.0),
        "friction": (0.3, 1.0),
        "rotor_inertia": (0.0, 1e-7),
    }
    env = make(ranges=ranges)
    for seed in range(5):
        env.reset(seed=seed)
        twin = make(params=env.params)
        twin.reset(
            options={
                "state": env.state[:4],
                "mode": ["single_stance", "double_stance"][int(env.state[MODE])],
            }
        )
        for action in swinging(80, seed):
            one, two = env.step(action), twin.step(action)
            assert one[0] == pytest.approx(two[0], abs=1e-6)
            demand = max(env.measurements[name] for name in DEMANDS) / env.params.friction
            if abs(demand - LIMIT) > 1e-6:  # there the penalty for a slip sets in
                assert one[1] == pytest.approx(two[1], abs=1e-9)
            assert env.measurements["idle"] == pytest.approx(twin.measurements["idle"], rel=1e-12)
            if one[2] or two[2]:
                break


def test_ranges_and_disturbances_hold_until_they_are_replaced():
    env = make()
    env.reset(seed=0, options={"ranges": {"slope": (0.01, 0.02)}})
    slopes = [env.params.slope]
    for options in (None, {"params": PROTOTYPE}, {"ranges": {}}):
        env.reset(options=options)
        slopes.append(env.params.slope)
    assert all(0.01 <= slope < 0.02 for slope in slopes[:3])
    assert len(set(slopes[:3])) == 3
    assert slopes[3] == 0.0
    assert env.params == PROTOTYPE
    pushes = Disturbances(pushes=Pushes(rate=ALWAYS, impulse=(0.1, 0.1)))
    for options, push in (
        ({"disturbances": pushes}, True),
        ({}, True),
        ({"disturbances": None}, False),
    ):
        env.reset(options=options)
        env.step(np.zeros(1, np.float32))
        assert (env.measurements["push"] != 0.0) is push


def test_empty_disturbances_change_nothing_and_real_ones_keep_the_start():
    plain, empty = make(), make(ranges={}, disturbances=Disturbances())
    rough = make(
        disturbances=Disturbances(actuator_delay=(0, 5), pushes=Pushes(rate=9.0, impulse=(0, 1)))
    )
    for seed in range(6):
        first = plain.reset(seed=seed)[0]
        assert np.array_equal(first, empty.reset(seed=seed)[0])
        assert np.array_equal(first, rough.reset(seed=seed)[0])
        for action in swinging(20, seed):
            one, two = plain.step(action), empty.step(action)
            assert np.array_equal(one[0], two[0])
            assert one[1:4] == two[1:4]
            if one[2]:
                break
