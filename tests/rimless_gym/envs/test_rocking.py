"""A wheel with lossless touchdowns rocks until it rests, and does not stop other rows."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import DOUBLE, LOSSES
from tests.rimless_gym.envs.rows import make

LIGHT = THESIS_PHYSICAL.replace(
    leg_length=0.07, n_legs=4, pendulum_mass=0.3, wheel_inertia=0.001, impact_law="relabel"
)
SPENT = (*LOSSES, "collision", "mechanical_change")


def test_slow_rocking_ends_in_rest_and_balances_alone_and_in_rows() -> None:
    start = {"state": [LIGHT.constants.a, 0.01, 5e-3, 0.05]}
    env, envs = gym.make("RimlessWheel-v0", params=LIGHT), make(3, params=[THESIS_PHYSICAL] * 3)
    env.reset(options=start)
    params = [THESIS_PHYSICAL, LIGHT, THESIS_PHYSICAL]
    states = [[THESIS_PHYSICAL.constants.a, 0.0, 0.5, 0.0]] * 3
    states[1] = start["state"]
    envs.reset(seed=0, options={"params": params, "state": states})
    touchdowns = 0
    for _ in range(20):
        seen, _, ended, _, info = env.step(np.zeros(1, np.float32))
        rows = envs.step(np.zeros((3, 1), np.float32))
        assert not ended
        assert np.array_equal(rows[0][1], seen)
        assert info["electrical"] == pytest.approx(sum(info[name] for name in SPENT), abs=1e-12)
        touchdowns += info["touchdowns"]
    assert touchdowns > 10
    assert info["mode"] == rows[-1]["mode"][1] == DOUBLE
