"""The environments that stable-baselines3's algorithms train in, and wrappers around them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.checks import integer, positive
from rimless_gym.envs.task import Task

#: A wrapper, and its arguments besides what it encloses.
Wrapping = tuple[type[VecEnvWrapper], Mapping[str, Any]]

_Kind = TypeVar("_Kind", bound=VecEnv)


def training_env(
    n_envs: int,
    conditions: Conditions,
    task: Task,
    seed: int,
    wrappers: Sequence[Wrapping] = (),
    episode_steps: int | None = None,
    native_wrappers: Sequence[Callable[[Any], VectorEnv[Any, Any, Any]]] = (),
) -> VecEnvWrapper:
    """`n_envs` environments side by side, in a monitor.

    `wrappers` are around the monitored ones, from the inside out. The longest episode has
    `episode_steps` control intervals; None: as the environment has them.
    `native_wrappers` are around the native environment, below the monitor.
    """
    limit = {} if episode_steps is None else {"max_episode_steps": episode_steps}
    envs: VectorEnv[Any, Any, Any] = conditions.envs(
        n_envs, task=task, autoreset_mode=AutoresetMode.SAME_STEP, **limit
    )
    for around in native_wrappers:
        envs = around(envs)
    native = Sb3VecEnv(envs)
    native.seed(seed)
    env: VecEnvWrapper = VecMonitor(native)
    for kind, arguments in wrappers:
        env = kind(env, **arguments)
    return env


def wrapped(env: Any, kind: type[_Kind]) -> _Kind:
    """The outermost of some environments and their wrappers that is of a kind."""
    layer = env
    while not isinstance(layer, kind):
        if not isinstance(layer, VecEnvWrapper):
            raise TypeError(f"{env}: has no {kind.__name__}")
        layer = layer.venv
    return layer


class ScaledRewards(VecEnvWrapper):
    """Rewards are so many times as large: a critic's errors hardly shrink with its targets.

    Args:
        venv: environments.
        scale: greater than 0.
    """

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self.scale = positive("scale", scale)

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments return, with other rewards."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, self.scale * rewards, dones, infos


class HeldActions(VecEnvWrapper):
    """Actions are held for several control intervals; a time step is all of them.

    Noise that changes every 10 ms hardly moves the pendulum: an untrained policy explores more if
    its actions last longer. The observations are the same, so that the policy may decide in every
    control interval later. When an episode ends in between, the action goes on into the next one,
    and the learner receives none of its rewards.

    A monitor belongs below: `HeldActions(VecMonitor(envs), 4)`. One above works too, but counts
    decisions instead of control intervals, and its returns lack the rewards that are dropped.

    Args:
        venv: environments.
        intervals: for which an action is held, 1 or more.
    """

    def __init__(self, venv: VecEnv, intervals: int = 1) -> None:
        super().__init__(venv)
        self.intervals = integer("intervals", intervals, 1)
        self._actions = np.zeros(0)

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Hold the actions; rewards are summed until an episode ends."""
        observations, total, over, infos = self.venv.step(self._actions)
        for _ in range(self.intervals - 1):
            observations, rewards, ended, latest = self.venv.step(self._actions)
            total = total + np.where(over, np.float32(0.0), rewards)
            infos = [
                old if done else new for done, old, new in zip(over, infos, latest, strict=True)
            ]
            over = over | ended
        return observations, total, over, infos
