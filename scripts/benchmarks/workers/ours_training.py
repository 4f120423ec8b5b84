"""The share of PPO's training time that goes into our environments and their adapter."""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.conditions import Conditions
from agents.sb3.training_env import training_env
from rimless_gym.envs.task import Task
from scripts.benchmarks.protocol import Measure, serve
from scripts.benchmarks.walks import PARAMS


class Stopwatch(VecEnvWrapper):
    """Adds up the time that a learner waits for its environments."""

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        self.seconds = 0.0
        self.begin = 0.0

    def reset(self) -> VecEnvObs:
        """The first observations."""
        begin = time.perf_counter()
        observations = self.venv.reset()
        self.seconds += time.perf_counter() - begin
        return observations

    def step_async(self, actions: Any) -> None:
        """The clock runs from here to the end of `step_wait`: nothing happens in between."""
        self.begin = time.perf_counter()
        self.venv.step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments give."""
        answer = self.venv.step_wait()
        self.seconds += time.perf_counter() - self.begin
        return answer


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """A measurement is one `learn` of one rollout, however long it takes."""
    torch.set_num_threads(1)
    n, arguments = settings["n"], settings["ppo"]
    env = Stopwatch(training_env(n, Conditions(PARAMS), Task(), seed=0))
    model = PPO("MlpPolicy", env, seed=0, device="cpu", **arguments)

    def measure(seconds: float) -> dict[str, Any]:
        before, begin = env.seconds, time.perf_counter()
        steps = model.n_steps * n
        model.learn(steps, reset_num_timesteps=False)
        elapsed = time.perf_counter() - begin
        return {"steps": steps, "seconds": elapsed, "share": (env.seconds - before) / elapsed}

    return measure, {"version": f"stable-baselines3 {version('stable_baselines3')}"}


if __name__ == "__main__":
    serve(setup)
