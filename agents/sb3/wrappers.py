"""The environments that stable-baselines3's algorithms train in, and wrappers around them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.checks import integer, not_negative, positive
from rimless_gym.envs import EPISODE_STEPS
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
) -> VecEnvWrapper:
    """`n_envs` environments side by side; what monitors them receives the environment's rewards.

    `wrappers` are around the monitored ones, from the inside out. The longest episode has
    `episode_steps` control intervals; None: as the environment has them.
    """
    limit = {} if episode_steps is None else {"max_episode_steps": episode_steps}
    native = Sb3VecEnv(
        conditions.envs(n_envs, task=task, autoreset_mode=AutoresetMode.SAME_STEP, **limit)
    )
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
            raise TypeError(f"{env}: has no {kind.__name__}; list it in vec_env_wrapper")
        layer = layer.venv
    return layer


class _Wrapper(VecEnvWrapper):
    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()


class ScaledReward(_Wrapper):
    """Multiplies rewards by a factor; what monitors `venv` below receives them in metres.

    They are metres per 10 ms, a few thousandths; learners like them nearer to 1.
    """

    def __init__(self, venv: VecEnv, scale: float = 1.0) -> None:
        super().__init__(venv)
        self.scale = positive("scale", scale)

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments return, the rewards times the scale."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, self.scale * rewards, dones, infos


class HeldActions(_Wrapper):
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


class StartUpPhase(_Wrapper):
    """Makes energy free in the first control intervals of an episode; falls and slips are not.

    Afterwards every touchdown that is a step backward may have a penalty: a wheel that comes out of
    a touchdown too slowly rocks back onto the leg behind, and then forward again. Some gaits have
    such a step in every stride, and policies stay in them, because rocking a little less gains
    little. Leaving double stance backward, which takes no touchdown, costs half.

    To pump the pendulum up takes many times the energy of the walk that follows. If both cost
    alike, then near the optimum, where the reward weight of distance is low, starting up
    is never worth its cost within a learner's horizon: to fall at once costs less. So a learner
    whose gait becomes more efficient learns to fall.

    Args:
        venv: a monitor of a `Sb3VecEnv`. What it monitors is not changed.
        intervals: control intervals of an episode in which this is so.
        travel: share of the travel that is rewarded in them. If none is, a policy that has always
            had noise to start it may forget how to leave rest.
        penalty: for each step backward afterwards (m), as the energy that lifts the wheel so far.

    Attributes:
        intervals, travel, penalty: as given; the penalty may be changed at any time.
        monitor: `venv`.
        native: the environments that it monitors.
        steps: of each row since this was made, (N,); those backward count as -1.
    """

    def __init__(
        self, venv: VecMonitor, intervals: int = 0, travel: float = 0.0, penalty: float = 0.0
    ) -> None:
        assert isinstance(venv.venv, Sb3VecEnv)
        super().__init__(venv)
        self.intervals = integer("intervals", intervals, 0)
        self.travel = not_negative("travel", travel)
        self.penalty = not_negative("penalty", penalty)
        self.monitor, self.native = venv, venv.venv
        self.steps = np.zeros(venv.num_envs, dtype=np.int64)

    @property
    def starting(self) -> NDArray[np.bool_]:
        """Whether the next interval of each row is one of the first, (N,)."""
        return np.asarray(self.monitor.episode_lengths < self.intervals)

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments return, with other rewards."""
        starting = self.starting
        observations, rewards, dones, infos = self.venv.step_wait()
        info = self.native.last_info
        self.steps = self.steps + info["steps"]
        free = self.travel * info["reward_distance"] + info["reward_slip"] + info["reward_end"]
        rewards = np.where(starting, free.astype(np.float32), rewards)
        if self.penalty > 0.0:
            backward = (info["touchdowns"] - info["steps"]) / 2  # `steps` counts them as -1
            rewards = (rewards - self.penalty * ~starting * backward).astype(np.float32)
        return observations, rewards, dones, infos


def begin_out_of_step(
    env: VecEnvWrapper, act: Callable[[NDArray[np.float32]], NDArray[Any]]
) -> NDArray[np.float32]:
    """Walk for the time of an episode, in which one row after the other begins anew.

    Otherwise all rows of a `training_env` would start up together, and again a time limit later: a
    roll-out would contain nothing else, and the next ones none of it. Returns the observations
    (N, 6 or 8) of rows of all ages.
    """
    seen = np.asarray(env.reset())
    native, monitor = wrapped(env, Sb3VecEnv), wrapped(env, VecMonitor)
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
