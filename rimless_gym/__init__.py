"""rimless-gym: energy-efficient walking with the simplest walker there is."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

from rimless_gym.envs import (
    EPISODE_STEPS,
    REWARD_THRESHOLD,
    SPEED_EPISODE_STEPS,
    SPEED_REWARD_THRESHOLD,
)
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL, preset

if TYPE_CHECKING:  # what `__getattr__` finds
    from rimless_gym.envs.disturbances import Disturbances, Pushes, Ranges, SensorNoise, Terrain
    from rimless_gym.envs.env import RimlessWheelEnv
    from rimless_gym.envs.speed import RimlessWheelSpeedEnv, RimlessWheelSpeedVectorEnv
    from rimless_gym.envs.starts import Starts
    from rimless_gym.envs.task import Task
    from rimless_gym.envs.vector_env import RimlessWheelVectorEnv
    from rimless_gym.hybrid import Failure
    from rimless_gym.reference import simulate
    from rimless_gym.trajectory import Trajectory

    __version__: str

__all__ = [
    "BUILDABLE",
    "PROTOTYPE",
    "THESIS_NOMINAL",
    "THESIS_PHYSICAL",
    "Disturbances",
    "Failure",
    "Pushes",
    "Ranges",
    "RimlessWheelEnv",
    "RimlessWheelSpeedEnv",
    "RimlessWheelSpeedVectorEnv",
    "RimlessWheelVectorEnv",
    "SensorNoise",
    "Starts",
    "Task",
    "Terrain",
    "Trajectory",
    "WheelParams",
    "__version__",
    "preset",
    "simulate",
]

# Names that are imported on first use, and their modules. These modules need numba, SciPy or
# CasADi, which take longer to import than everything else.
_MODULES = {
    "Disturbances": "envs.disturbances",
    "Failure": "hybrid",
    "Pushes": "envs.disturbances",
    "Ranges": "envs.disturbances",
    "RimlessWheelEnv": "envs.env",
    "RimlessWheelSpeedEnv": "envs.speed",
    "RimlessWheelSpeedVectorEnv": "envs.speed",
    "RimlessWheelVectorEnv": "envs.vector_env",
    "SensorNoise": "envs.disturbances",
    "Starts": "envs.starts",
    "Task": "envs.task",
    "Terrain": "envs.disturbances",
    "Trajectory": "trajectory",
    "simulate": "reference",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value = version("rimless-gym")
    elif name in _MODULES:
        value = getattr(importlib.import_module(f"rimless_gym.{_MODULES[name]}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


# The environments themselves raise the errors that Gymnasium's wrappers check for in every step.
gymnasium.register(
    id="RimlessWheel-v0",
    entry_point="rimless_gym.envs.env:RimlessWheelEnv",
    vector_entry_point="rimless_gym.envs.vector_env:RimlessWheelVectorEnv",
    reward_threshold=REWARD_THRESHOLD,
    max_episode_steps=EPISODE_STEPS,
    order_enforce=False,
    disable_env_checker=True,
)
gymnasium.register(
    id="RimlessWheelSpeed-v0",
    entry_point="rimless_gym.envs.speed:RimlessWheelSpeedEnv",
    vector_entry_point="rimless_gym.envs.speed:RimlessWheelSpeedVectorEnv",
    reward_threshold=SPEED_REWARD_THRESHOLD,
    max_episode_steps=SPEED_EPISODE_STEPS,
    order_enforce=False,
    disable_env_checker=True,
)
