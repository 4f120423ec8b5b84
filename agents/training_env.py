"""The environments that learners train in."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

import rimless_gym  # noqa: F401  registers RimlessWheel-v0
from agents.sb3_vec_env import Sb3VecEnv
from rimless_gym.envs.snapshots import ARRAYS
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams


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
) -> ScaledReward:
    """`n_envs` environments side by side; returns are monitored before the reward is scaled."""
    native = gym.make_vec(
        "RimlessWheel-v0",
        num_envs=n_envs,
        params=params,
        task=task,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    env = Sb3VecEnv(native)
    env.seed(seed)
    return ScaledReward(VecMonitor(env), reward_scale)


def environments_state(env: ScaledReward) -> dict[str, Any]:
    """The state of the environments of `training_env`, as arrays and plain values."""
    monitor, native = _layers(env)
    snapshot = native.get_state()
    return {
        "arrays": {name: snapshot["fleet"][name] for name in ARRAYS},
        "generators": snapshot["generators"],
        "seen": snapshot["seen"],
        "returns": monitor.episode_returns.copy(),
        "lengths": monitor.episode_lengths.copy(),
    }


def set_environments_state(env: ScaledReward, state: dict[str, Any]) -> None:
    """Put environments made with the same arguments into a state from `environments_state`.

    Raises:
        KeyError: a part of it is missing.
        TypeError: a part of it is of the wrong kind.
        ValueError: it is from another number of environments.
    """
    monitor, native = _layers(env)
    snapshot = native.get_state()
    native.set_state(
        {
            "fleet": snapshot["fleet"] | {name: state["arrays"][name] for name in ARRAYS},
            "generators": state["generators"],
            "seen": state["seen"],
        }
    )
    monitor.episode_returns, monitor.episode_lengths = state["returns"], state["lengths"]


def _layers(env: Any) -> tuple[Any, Any]:
    """The monitor around the environments, and the native vector environment inside it."""
    monitor = env.venv
    return monitor, monitor.venv.env
