"""Environments and actions for the tests in this folder."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from rimless_gym import Disturbances, Pushes, RimlessWheelVectorEnv, SensorNoise, Terrain

ID, SPEED_ID = "RimlessWheel-v0", "RimlessWheelSpeed-v0"
STILL = np.zeros(1, np.float32)
NEXT, SAME, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
ROUGH: dict[str, Any] = {
    "ranges": {"slope": (-0.03, 0.03), "pendulum_mass": (2.0, 2.4), "idle_power": (0.0, 2.0)},
    "disturbances": Disturbances(
        pushes=Pushes(rate=5.0, impulse=(0.1, 1.5)),
        sensor_noise=SensorNoise(leg_angle=0.01, pendulum_angle=0.02, leg_rate=0.1),
        actuator_delay=(0, 3),
        terrain=Terrain(slope_std=0.05),
    ),
}


def make(n: int, mode: AutoresetMode = NEXT, id: str = ID, **settings: Any) -> Any:
    envs = gym.make_vec(id, num_envs=n, autoreset_mode=mode, **settings)
    assert isinstance(envs, RimlessWheelVectorEnv)
    return envs


def swinging(n: int, steps: int, seed: int = 0, hold: int = 20) -> np.ndarray:
    """Random actions (steps, n, 1), held so long that wheels fall."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-1.2, 1.2, (-(-steps // hold), n, 1)).astype(np.float32)
    return np.repeat(levels, hold, axis=0)[:steps]
