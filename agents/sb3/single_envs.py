"""One native vector environment in place of many single ones, where that changes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from stable_baselines3.common.monitor import Monitor

from rimless_gym import (
    RimlessWheelSpeedEnv,
    RimlessWheelSpeedVectorEnv,
    RimlessWheelVectorEnv,
)
from rimless_gym.envs.env import RimlessWheelEnv

#: The native environment of each single one.
NATIVE: dict[type, type[RimlessWheelVectorEnv]] = {
    RimlessWheelEnv: RimlessWheelVectorEnv,
    RimlessWheelSpeedEnv: RimlessWheelSpeedVectorEnv,
}

#: Wrappers whose effect `Sb3VecEnv` reproduces.
HONOURED = (Monitor, TimeLimit, OrderEnforcing, PassiveEnvChecker)


def wrappers(env: gym.Env[Any, Any]) -> Iterator[gym.Wrapper[Any, Any, Any, Any]]:
    """The wrappers around an environment, from the outside in."""
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env


def gathered(envs: Sequence[gym.Env[Any, Any]]) -> RimlessWheelVectorEnv:
    """Rows that behave like the single environments, with autoreset in the same step.

    Raises:
        TypeError: the class of an environment is not in `NATIVE`.
        ValueError: there are none, they differ in more than `params`, or one has a wrapper whose
            effect cannot be reproduced.
    """
    if not envs:
        raise ValueError("no environments: give at least one function that makes one")
    settings = [_settings(env) for env in envs]
    shared = {name: value for name, value in settings[0].items() if name != "params"}
    for i, other in enumerate(settings):
        for name, value in shared.items():
            if other[name] != value:
                raise ValueError(
                    f"environment {i} has {name} = {other[name]}, the first {value}: they may "
                    "differ in params only; use DummyVecEnv for others"
                )
    native = shared.pop("native")
    return native(
        num_envs=len(envs),
        params=[each["params"] for each in settings],
        autoreset_mode=AutoresetMode.SAME_STEP,
        **shared,
    )


def _settings(env: gym.Env[Any, Any]) -> dict[str, Any]:
    """The arguments with which the native environment behaves like this one."""
    single: Any = env.unwrapped
    limits = []
    if type(single) not in NATIVE:
        names = " or a ".join(kind.__name__ for kind in NATIVE)
        raise TypeError(
            f"{single}: must be a {names}, whose rows are stepped natively; use DummyVecEnv for "
            "others"
        )
    for wrapper in wrappers(env):
        if type(wrapper) not in HONOURED:
            name = type(wrapper).__name__
            raise ValueError(
                f"wrapper {name}: native rows cannot be wrapped one by one; put a VecEnvWrapper "
                f"that does the same around the vector, or use DummyVecEnv with {name}"
            )
        if isinstance(wrapper, Monitor) and (
            wrapper.reset_keywords or not wrapper.allow_early_resets
        ):
            raise ValueError(
                "wrapper Monitor: reset_keywords and allow_early_resets=False are for single "
                "environments; leave them out, or use DummyVecEnv"
            )
        if isinstance(wrapper, TimeLimit):
            limits.append(wrapper._max_episode_steps)
    if single.max_episode_steps is not None:
        limits.append(single.max_episode_steps)
    if single.render_mode not in (None, "rgb_array"):
        raise ValueError(
            f"render_mode = {single.render_mode!r}: rows have no windows; choose 'rgb_array', or "
            "use DummyVecEnv"
        )
    batch = single.get_state()["batch"]  # the machine before anything was drawn
    commanded = {} if single.control.speeds is None else {"speeds": single.control.speeds}
    return {
        "native": NATIVE[type(single)],
        "params": batch["params"][0],
        "task": single.task,
        "ranges": batch["ranges"],
        "disturbances": batch["disturbances"],
        "starts": batch["starts"],
        "control_period": single.control.period,
        "actions": single.control.actions,
        "max_episode_steps": min(limits, default=None),
        "render_mode": single.render_mode,
        **commanded,
    }
