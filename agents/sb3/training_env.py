"""The environments that stable-baselines3's algorithms train in."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym.envs.task import Task


class ScaledReward(VecEnvWrapper):
    """Rewards are metres per 10 ms, a few thousandths; learners like them nearer to 1.

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


def training_env(
    n_envs: int, conditions: Conditions, task: Task, seed: int, reward_scale: float = 1.0
) -> ScaledReward:
    """`n_envs` environments side by side; returns are monitored before the reward is scaled."""
    env = Sb3VecEnv(conditions.envs(n_envs, task=task, autoreset_mode=AutoresetMode.SAME_STEP))
    env.seed(seed)
    return ScaledReward(VecMonitor(env), reward_scale)


def native_of(env: Any) -> Sb3VecEnv:
    """The innermost environment of a `training_env`."""
    found = env.venv.venv
    assert isinstance(found, Sb3VecEnv)
    return found
