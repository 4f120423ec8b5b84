"""The environments that stable-baselines3's algorithms train in."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.sb3.hard_starts import HardStarts
from agents.sb3.setting_off import SettingOff
from agents.sb3.stepping_back import SteppingBack
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.checks import integer, not_negative, positive
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.task import Task


class ScaledReward(VecEnvWrapper):
    """Multiplies rewards by a factor.

    They are metres per 10 ms, a few thousandths; learners like them nearer to 1.

    Args:
        venv: environments; what monitors them below sees the rewards in metres.
        scale: factor on the rewards.
    """

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self.scale = scale

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

    def __init__(self, venv: VecEnv, intervals: int) -> None:
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Offer:
    """What the environments of a training offer to its learner.

    Attributes:
        reward_scale: factor on the rewards.
        held: control intervals for which an action is held.
        setting_off: control intervals at the beginning of an episode that are paid by `SettingOff`.
        travel: share of the travel that is paid in them.
        back_charge: for each step backward (m).
        hard_starts: share of episodes that begin where another one has gone wrong.
        episode_steps: control intervals of the longest episode; None: as the environment has them.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a number is out of its range.
    """

    reward_scale: float = 1.0
    held: int = 1
    setting_off: int = 0
    travel: float = 0.0
    back_charge: float = 0.0
    hard_starts: float = 0.0
    episode_steps: int | None = None

    def __post_init__(self) -> None:
        positive("scale", self.reward_scale)
        integer("intervals", self.held, 1)
        integer("intervals", self.setting_off, 0)
        not_negative("charge", self.back_charge)
        not_negative("share", self.hard_starts)
        if self.episode_steps is not None:
            integer("max_episode_steps", self.episode_steps, 1)


def training_env(
    n_envs: int, conditions: Conditions, task: Task, seed: int, offer: Offer | None = None
) -> ScaledReward:
    """`n_envs` environments side by side; what monitors them sees the environment's rewards.

    Raises:
        ValueError: wheels set off for whole episodes, so that energy would never be charged; or
            there are hard starts and ranges.
    """
    offer, same_step = offer or Offer(), AutoresetMode.SAME_STEP
    limit = {} if offer.episode_steps is None else {"max_episode_steps": offer.episode_steps}
    env = Sb3VecEnv(conditions.envs(n_envs, task=task, autoreset_mode=same_step, **limit))
    if offer.hard_starts and conditions.ranges.bounds:
        raise ValueError(
            f"HardStarts: share = {offer.hard_starts:g}: a start of one machine need not be one of "
            "another; give no ranges, or a share of 0"
        )
    longest = env.env.max_episode_steps
    if longest is not None and offer.setting_off >= longest:
        raise ValueError(
            f"SettingOff: intervals = {offer.setting_off}: an episode has {longest}, and in all of "
            "them energy would be free; give fewer, or a longer TimeLimit (max_episode_steps)"
        )
    env.seed(seed)
    paid = SettingOff(VecMonitor(env), offer.setting_off, offer.travel)
    charged = SteppingBack(paid, offer.back_charge)
    begun = HardStarts(charged, offer.hard_starts, seed)
    return ScaledReward(HeldActions(begun, offer.held), offer.reward_scale)


def begin_out_of_step(
    env: ScaledReward, act: Callable[[NDArray[np.float32]], NDArray[Any]]
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
    hard_starts_of(env).forget()
    native, monitor = native_of(env), monitor_of(env)
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


def hard_starts_of(env: Any) -> HardStarts:
    """What begins again from hard starts in a `training_env`."""
    found = env.venv.venv
    assert isinstance(found, HardStarts)
    return found


def stepping_back_of(env: Any) -> SteppingBack:
    """What charges steps backward in a `training_env`."""
    found = hard_starts_of(env).venv
    assert isinstance(found, SteppingBack)
    return found


def setting_off_of(env: Any) -> SettingOff:
    """What pays in a `training_env`."""
    found = stepping_back_of(env).venv
    assert isinstance(found, SettingOff)
    return found


def monitor_of(env: Any) -> VecMonitor:
    """What monitors the returns of a `training_env`."""
    return setting_off_of(env).monitor


def native_of(env: Any) -> Sb3VecEnv:
    """The innermost environment of a `training_env`."""
    return setting_off_of(env).native
