"""The environment begins in any state of an optimal gait, however fast the pendulum whirls."""

from __future__ import annotations

import numpy as np

from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.starts import normal_force
from trajopt.gaits.library import shipped


def test_an_episode_can_start_in_every_state_of_the_shipped_gaits() -> None:
    pulled = 0
    for gait in shipped():
        env = RimlessWheelEnv(gait.params)
        for t in np.linspace(0.0, gait.duration, 16):
            state = gait.state(t)
            env.reset(options={"state": state})
            assert np.array_equal(env.state[:4], state)
            pulled += normal_force(gait.params, env.state) <= 0
            action = np.array([gait.control(t) / gait.params.voltage_limit])
            assert env.step(action)[-1]["elapsed"] > 0 or gait.params.impact_law != "plastic"
    assert pulled > 40  # these need the gait's voltage to stand
