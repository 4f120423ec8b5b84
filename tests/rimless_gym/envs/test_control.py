"""How long an action is held, what it commands, and how long episodes are then."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import BUILDABLE, Disturbances, Pushes, RimlessWheelEnv
from rimless_gym.envs.layout import MEMORY
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.equations import LOSSES, equations
from rimless_gym.kernel.stepping import DPHI, DTHETA
from tests.rimless_gym.envs.rows import ID, SAME, STILL, make, swinging

ENERGIES = ("electrical", "electrical_positive", "idle", "collision", "mechanical_change", *LOSSES)
number = equations(math.sin, math.cos)


@pytest.mark.parametrize("ticks", [2, 4])
def test_short_intervals_at_one_voltage_equal_one_long_interval(ticks: int) -> None:
    n = 500
    short, long = make(n, SAME), make(n, SAME, control_period=ticks * 0.01)
    for envs in (short, long):
        envs.reset(seed=0)
    actions, running, parts = swinging(n, 1)[0], np.ones(n, dtype=bool), []
    for _ in range(ticks):
        _, _, ended, _, info = short.step(actions)
        running &= ~ended
        parts.append(info)
    _, _, ended, _, whole = long.step(actions)
    running &= ~ended
    assert np.abs(short.states - long.states)[running].max() < 0.5e-10 * ticks
    for name in ENERGIES:
        total = sum(part[name] for part in parts)
        assert np.abs(total - whole[name])[running].max() < 1e-9
    assert running.sum() > 0.9 * n
    assert whole["touchdowns"][running].any()


def test_rewards_and_info_are_of_an_interval_whatever_its_length() -> None:
    env = RimlessWheelEnv(control_period=0.05)
    env.reset(options={"mode": "double_stance"})
    _, reward, _, _, info = env.step(STILL)
    assert env.measurements["elapsed"] == pytest.approx(0.05, abs=1e-15)
    assert env.measurements["idle"] == pytest.approx(0.05 * BUILDABLE.idle_power)
    assert reward == pytest.approx(sum(info[name] for name in TERM_NAMES), rel=1e-15)


def test_pushes_come_as_often_and_delays_last_as_many_intervals() -> None:
    pushes = Disturbances(pushes=Pushes(rate=5.0, impulse=(0.01, 0.01)))
    for period in (0.01, 0.1):
        envs = make(100, SAME, control_period=period, disturbances=pushes)
        envs.reset(seed=0, options={"mode": "double_stance"})
        steps = round(1.0 / period)
        pushed = sum(
            (envs.step(np.zeros((100, 1), np.float32))[-1]["push"] != 0).sum() for _ in range(steps)
        )
        least = -math.expm1(-5.0 * period) / period * 100
        assert pushed == pytest.approx(least, rel=0.15)
    env = gym.make(ID, control_period=0.03, disturbances={"actuator_delay": 2})
    env.reset(options={"mode": "double_stance"})
    electrical = [env.step(np.ones(1, np.float32))[-1]["electrical_positive"] for _ in range(3)]
    assert electrical[:2] == [0.0, 0.0]
    assert electrical[2] > 0.0


@pytest.mark.parametrize(("period", "steps"), [(0.01, 2000), (0.03, 667), (0.1, 200)])
def test_an_episode_is_truncated_after_20_seconds(period: float, steps: int) -> None:
    env, envs = gym.make(ID, control_period=period), make(2, SAME, control_period=period)
    env.reset(options={"mode": "double_stance"})
    envs.reset(options={"mode": "double_stance"})
    assert envs.max_episode_steps == steps
    all_still = np.zeros((2, 1), np.float32)
    for _ in range(steps - 1):
        assert not env.step(STILL)[3]
        assert not envs.step(all_still)[3].any()
    assert env.step(STILL)[2:4] == (False, True)
    assert envs.step(all_still)[3].all()


@pytest.mark.parametrize("mount", ["wheel", "frame"])
def test_a_current_is_driven_at_the_beginning_of_the_interval(mount: str) -> None:
    params = BUILDABLE.replace(motor_mount=mount)
    p, limit = params.constants, params.voltage_limit
    envs = make(40, SAME, params=params, actions="current")
    envs.reset(seed=0)
    clipped = 0
    for actions in swinging(40, 30, hold=3):
        x = envs.states
        ended = envs.step(actions)[2]
        volts = envs.get_state()["batch"]["memory"][MEMORY.voltage, :40]
        shares = np.clip(actions[:, 0].astype(float), -1.0, 1.0)
        for row, volt, share in zip(x[~ended], volts[~ended], shares[~ended], strict=True):
            dpsi = number.relative_rate(row[DPHI], row[DTHETA], p)
            current = number.motor_current(dpsi, volt, p)
            wanted = share * limit / params.armature_resistance
            if abs(volt) < limit:
                assert current == pytest.approx(wanted, abs=1e-12)
            else:
                clipped += 1
                assert abs(volt) == limit
                assert (wanted - current) * volt >= 0.0  # it would take still more voltage
    assert clipped


def test_no_current_costs_no_energy_at_the_beginning_and_any_current_as_much_as_it_takes() -> None:
    env = RimlessWheelEnv(actions="current")
    env.reset(options={"mode": "double_stance"})
    env.step(STILL)
    assert env.measurements["electrical"] == 0.0
    stall = BUILDABLE.voltage_limit / BUILDABLE.armature_resistance
    env.step(np.full(1, 0.1, np.float32))
    assert env.measurements["copper"] == pytest.approx(
        (0.1 * stall) ** 2 * BUILDABLE.armature_resistance * 0.01, rel=0.2
    )
