"""Setting off and walking are two problems, so they are paid apart and count apart.

To pump the pendulum up takes many times the energy of the walk that follows. If both are charged
alike, then near the optimum, where the price of distance is low, setting off never pays within a
learner's horizon: to fall at once is cheaper. So a learner whose gait gets cheaper learns to fall.

- `SettingOff` charges no energy in the first seconds of an episode, and pays for little of the
  travel, so that no dear gait is learned there. Falls and slips are charged as always.
- `CountApart` gives the advantages of those seconds, of walking and of wheels that have stalled the
  same spread. Otherwise those of the gait, which hardly vary, are lost among the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.checks import integer, not_negative

#: Advantages further from the median than so many spreads count as though they were at that limit.
LIMIT = 10.0

#: The percentage of a normal distribution that lies within one standard deviation.
WITHIN_SPREAD = 68.27


class SettingOff(VecEnvWrapper):
    """Makes energy free in the first control intervals of an episode; falls and slips are charged.

    Args:
        venv: a monitor of a `Sb3VecEnv`. What it monitors is not changed.
        intervals: control intervals of an episode in which this is so.
        travel: share of the travel that is paid in them. If none is, a policy that has always had
            noise to set it going may forget how to leave rest.

    Attributes:
        intervals, travel: as given.
        monitor: `venv`.
        native: the environments that it monitors.
        steps: of each row since this was made, (N,); those backward count as -1.

    Raises:
        TypeError: it is no such monitor, or a number is of the wrong kind.
        ValueError: a number is out of its range, or energy would be free for whole episodes.
    """

    def __init__(self, venv: VecMonitor, intervals: int = 0, travel: float = 0.0) -> None:
        if not isinstance(venv, VecMonitor) or not isinstance(venv.venv, Sb3VecEnv):
            raise TypeError(f"{venv}: must be a VecMonitor around an agents.Sb3VecEnv")
        super().__init__(venv)
        self.intervals = integer("intervals", intervals, 0)
        self.travel = not_negative("travel", travel)
        if travel > 1.0:
            raise ValueError(f"travel = {travel:g}: a share of the travel, must be at most 1")
        self.monitor, self.native = venv, venv.venv
        longest = self.native.env.max_episode_steps
        if longest is not None and self.intervals >= longest:
            raise ValueError(
                f"SettingOff: intervals = {intervals}: an episode has {longest}, and in all of "
                "them energy would be free; give fewer, or a longer TimeLimit (max_episode_steps)"
            )
        self.steps = np.zeros(venv.num_envs, dtype=np.int64)

    @property
    def setting_off(self) -> NDArray[np.bool_]:
        """Whether the next interval of each row is one of the first, (N,)."""
        return np.asarray(self.monitor.episode_lengths < self.intervals)

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments give, the rewards as said above."""
        first = self.setting_off
        observations, rewards, dones, infos = self.venv.step_wait()
        info = self.native.last_info
        self.steps = self.steps + info["steps"]
        paid = self.travel * info["reward_distance"] + info["reward_slip"] + info["reward_end"]
        return observations, np.where(first, paid.astype(np.float32), rewards), dones, infos


class CountApart(BaseCallback):
    """Gives advantages of setting off, of walking and of stalled wheels mean 0 and spread 1 each.

    A wheel has stalled if it has set off but gets no step forward in a roll-out, which should last
    longer than a step. A time step counts by its first control interval. For on-policy algorithms
    that do not normalise advantages themselves.

    Args:
        env: tells which intervals are which.
    """

    def __init__(self, env: SettingOff) -> None:
        super().__init__()
        self._env = env
        self._setting_off: list[NDArray[np.bool_]] = []
        self._begun_at = env.steps

    def _on_rollout_start(self) -> None:
        self._setting_off, self._begun_at = [self._env.setting_off], self._env.steps

    def _on_step(self) -> bool:
        self._setting_off.append(self._env.setting_off)
        return True

    def _on_rollout_end(self) -> None:
        buffer: Any = self.locals["rollout_buffer"]
        setting_off = np.array(self._setting_off[: len(buffer.advantages)])
        walks = self._env.steps > self._begun_at
        for samples in (setting_off, ~setting_off & walks, ~setting_off & ~walks):
            found = buffer.advantages[samples]
            if len(found) > 1:
                buffer.advantages[samples] = alike(found)


def alike(advantages: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Advantages (N,) with mean 0 and standard deviation 1, in which rare ones do not hide others.

    The spread is measured by the usual ones, and what is beyond `LIMIT` spreads is clipped.
    """
    centred = advantages - np.median(advantages)
    limit = LIMIT * np.percentile(np.abs(centred), WITHIN_SPREAD)
    if limit > 0.0:
        centred = np.clip(centred, -limit, limit)
    return (centred - centred.mean()) / (centred.std() + 1e-8)
