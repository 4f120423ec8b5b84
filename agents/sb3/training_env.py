"""The environments that stable-baselines3's algorithms train in."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.sb3.hard_starts import HardStarts
from agents.sb3.layers import arguments_of, is_drawn, layer_of
from agents.sb3.setting_off import SettingOff
from agents.sb3.stepping_back import SteppingBack
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.checks import integer, positive
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.task import Task


class ScaledReward(VecEnvWrapper):
    """Multiplies rewards by a factor.

    They are metres per 10 ms, a few thousandths; learners like them nearer to 1.

    Args:
        venv: environments; what monitors them below sees the rewards in metres.
        scale: factor on the rewards.

    Raises:
        TypeError: the scale is not a number.
        ValueError: it is not greater than 0.
    """

    def __init__(self, venv: VecEnv, scale: float = 1.0) -> None:
        super().__init__(venv)
        self.scale = positive("scale", scale)

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments give, the rewards times the scale."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, self.scale * rewards, dones, infos


class HeldActions(VecEnvWrapper):
    """Actions are held for several control intervals; a time step is all of them.

    Noise that changes every 10 ms hardly moves the pendulum: an untrained policy explores more if
    its actions last longer. The observations are the same, so that the policy may decide in every
    control interval later. When an episode ends in between, the action goes on into the next one,
    and the learner sees none of its rewards.

    A monitor belongs below: `HeldActions(VecMonitor(envs), 4)`. One above works too, but counts
    decisions instead of control intervals, and its returns lack the rewards that nobody sees.

    Args:
        venv: environments.
        intervals: for which an action is held.

    Raises:
        TypeError: the number of intervals is not an integer.
        ValueError: it is less than 1.
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


#: What may lie around the environments, from the inside out. By default, none does anything. A new
#: one is one more entry.
LAYERS: tuple[type[VecEnvWrapper], ...] = (
    SettingOff,
    SteppingBack,
    HardStarts,
    HeldActions,
    ScaledReward,
)


@dataclasses.dataclass(frozen=True)
class Offer:
    """What the environments of a training offer to its learner.

    Attributes:
        layers: arguments of `LAYERS` that differ from their defaults, by layer. They are checked
            when the environments are made.
        episode_steps: control intervals of the longest episode; None: as the environment has them.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a number is out of its range.
    """

    layers: Mapping[type[VecEnvWrapper], Mapping[str, Any]] = dataclasses.field(
        default_factory=dict
    )
    episode_steps: int | None = None

    def __post_init__(self) -> None:
        if self.episode_steps is not None:
            integer("max_episode_steps", self.episode_steps, 1)

    def value(self, kind: type[VecEnvWrapper], name: str) -> Any:
        """An argument of a layer, as given or by default."""
        return self.layers.get(kind, {}).get(name, arguments_of(kind)[name])


def training_env(
    n_envs: int, conditions: Conditions, task: Task, seed: int, offer: Offer | None = None
) -> VecEnvWrapper:
    """`n_envs` environments side by side; what monitors them sees the environment's rewards.

    Raises:
        TypeError, ValueError: as the layers say.
    """
    offer, same_step = offer or Offer(), AutoresetMode.SAME_STEP
    limit = {} if offer.episode_steps is None else {"max_episode_steps": offer.episode_steps}
    native = Sb3VecEnv(conditions.envs(n_envs, task=task, autoreset_mode=same_step, **limit))
    native.seed(seed)
    env: VecEnvWrapper = VecMonitor(native)
    for kind in LAYERS:
        arguments: dict[str, Any] = dict(offer.layers.get(kind, {}))
        if is_drawn(kind):
            arguments["seed"] = seed
        env = kind(env, **arguments)
    return env


def begin_out_of_step(
    env: VecEnvWrapper, act: Callable[[NDArray[np.float32]], NDArray[Any]]
) -> NDArray[np.float32]:
    """Walk for the time of an episode, in which one row after the other begins anew.

    Otherwise all rows of a `training_env` would set off together, and again a time limit later: a
    roll-out would have seen nothing else, and the next ones none of it.

    Args:
        env: as `training_env` makes it.
        act: observations (N, 6 or 8) -> actions (N,).

    Returns:
        Observations (N, 6 or 8) of rows of all ages.
    """
    seen = np.asarray(env.reset())
    layer_of(env, HardStarts).forget()
    native, monitor = layer_of(env, Sb3VecEnv), layer_of(env, VecMonitor)
    rows = native.env
    longest = rows.max_episode_steps or EPISODE_STEPS
    turns = np.arange(env.num_envs) * longest // env.num_envs
    for k in range(longest):
        seen, _, ended, timed_out, _ = rows.step(act(seen)[:, None])
        monitor.episode_lengths = np.where(ended | timed_out, 0, monitor.episode_lengths + 1)
        anew = turns == k
        if anew.any():
            seen[anew] = native.begin(anew)[anew]
            monitor.episode_lengths[anew] = 0
    return seen
