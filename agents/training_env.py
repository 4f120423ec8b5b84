"""The environments that learners train in."""

from __future__ import annotations

import numpy as np
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

import rimless_gym  # noqa: F401  registers RimlessWheel-v0
from rimless_gym.params import WheelParams
from rimless_gym.task import Task


class LeanVecEnv(DummyVecEnv):
    """DummyVecEnv without its deep copy of all infos, which costs more than the physics."""

    def step_wait(self) -> VecEnvStepReturn:
        """Step all environments; their infos are new dictionaries on every step."""
        for i, env in enumerate(self.envs):
            observation, reward, terminated, truncated, info = env.step(self.actions[i])
            self.buf_rews[i], self.buf_dones[i] = reward, terminated or truncated
            info["TimeLimit.truncated"] = truncated and not terminated
            if self.buf_dones[i]:
                info["terminal_observation"] = observation
                observation, self.reset_infos[i] = env.reset()
            self.buf_infos[i] = info
            self._save_obs(i, observation)
        return (
            self._obs_from_buf(),
            np.copy(self.buf_rews),
            np.copy(self.buf_dones),
            list(self.buf_infos),
        )


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
    n_envs: int, params: WheelParams, task: Task, seed: int, reward_scale: float = 1.0
) -> VecEnv:
    """`n_envs` environments side by side; returns are monitored before the reward is scaled."""
    env = make_vec_env(
        "RimlessWheel-v0",
        n_envs=n_envs,
        seed=seed,
        env_kwargs={"params": params, "task": task},
        vec_env_cls=LeanVecEnv,
    )
    return ScaledReward(env, reward_scale)
