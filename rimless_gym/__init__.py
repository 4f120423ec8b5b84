"""rimless-gym: energy-efficient walking with the simplest walker there is."""

import gymnasium

from rimless_gym.envs.disturbances import Disturbances, Pushes, Ranges, SensorNoise
from rimless_gym.envs.task import EPISODE_STEPS, Task
from rimless_gym.envs.vector_env import RimlessWheelVectorEnv
from rimless_gym.params import PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL, WheelParams, preset
from rimless_gym.simulate import simulate
from rimless_gym.trajectory import Trajectory

__all__ = [
    "PROTOTYPE",
    "THESIS_NOMINAL",
    "THESIS_PHYSICAL",
    "Disturbances",
    "Pushes",
    "Ranges",
    "RimlessWheelVectorEnv",
    "SensorNoise",
    "Task",
    "Trajectory",
    "WheelParams",
    "preset",
    "simulate",
]

gymnasium.register(
    id="RimlessWheel-v0",
    entry_point="rimless_gym.envs.env:RimlessWheelEnv",
    vector_entry_point="rimless_gym.envs.vector_env:RimlessWheelVectorEnv",
    max_episode_steps=EPISODE_STEPS,
    # The environment refuses by itself, with errors, what these wrappers look for in every step.
    order_enforce=False,
    disable_env_checker=True,
)
