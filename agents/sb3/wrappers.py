"""The environments that stable-baselines3's algorithms train in, and wrappers around them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.prior import PotentialShaping, Prior, ReferenceStarts
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.checks import integer, positive
from rimless_gym.envs.layout import LEG_RATE_SCALE, PENDULUM_RATE_SCALE
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import motor_voltage, relative_rate
from rimless_gym.params import WheelParams

#: A wrapper, and its arguments besides what it encloses.
Wrapping = tuple[type[VecEnvWrapper], Mapping[str, Any]]

#: The rates in an observation, of the legs and the pendulum.
RATES = slice(3, 5)

_Kind = TypeVar("_Kind", bound=VecEnv)


def training_env(
    n_envs: int,
    conditions: Conditions,
    task: Task,
    seed: int,
    wrappers: Sequence[Wrapping] = (),
    episode_steps: int | None = None,
    prior: Prior | None = None,
) -> VecEnvWrapper:
    """`n_envs` environments side by side; what monitors them receives the environment's rewards.

    `wrappers` are around the monitored ones, from the inside out. The longest episode has
    `episode_steps` control intervals; None: as the environment has them.
    With a `prior`, the rewards have its potential, and some episodes begin in its states.
    """
    limit = {} if episode_steps is None else {"max_episode_steps": episode_steps}
    envs: VectorEnv[Any, Any, Any] = conditions.envs(
        n_envs, task=task, autoreset_mode=AutoresetMode.SAME_STEP, **limit
    )
    if prior is not None:
        envs = PotentialShaping(ReferenceStarts(envs, prior), prior)
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


def back_emf_gains(params: WheelParams) -> NDArray[np.float32]:
    """The back-EMF, in voltage limits, for rates of 1 in an observation, of legs and pendulum."""
    p = params.constants
    rates = relative_rate(LEG_RATE_SCALE, 0.0, p), relative_rate(0.0, PENDULUM_RATE_SCALE, p)
    volts = [motor_voltage(rate, 0.0, p) for rate in rates]
    return np.array(volts, dtype=np.float32) / np.float32(params.voltage_limit)


@dataclasses.dataclass(frozen=True)
class Feedforward:
    """Actions are deviations from the back-EMF, the voltage at which no current flows.

    Without a deviation the pendulum swings freely.

    Attributes:
        params: the machine whose back-EMF it is, whichever walks.
        scale: the deviation for an action of 1, in voltage limits.
    """

    params: WheelParams
    scale: float

    def voltages(self, actions: NDArray[Any], observations: NDArray[np.float32]) -> NDArray[Any]:
        """Voltages (N, 1) in voltage limits, for actions (N, 1) and observations (N, 6 or 8)."""
        back_emf = observations[:, RATES] @ back_emf_gains(self.params)
        return np.asarray(np.clip(back_emf[:, None] + self.scale * actions, -1.0, 1.0))


class BackEmfFeedforward(VecEnvWrapper):
    """Actions are deviations from the back-EMF; see `Feedforward`.

    It belongs below `HeldActions`: so a deviation is held, and the back-EMF renewed in every
    control interval.

    Args:
        venv: environments.
        scale: the deviation for an action of 1, in voltage limits.
    """

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self._native = wrapped(venv, Sb3VecEnv).native
        # a property of many machines; where they are drawn, this is the first one
        self._feedforward = Feedforward(self._native.params[0], positive("scale", scale))

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Begin a step with these deviations."""
        self.venv.step_async(self._feedforward.voltages(actions, self._native.observations))

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments return."""
        return self.venv.step_wait()


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
