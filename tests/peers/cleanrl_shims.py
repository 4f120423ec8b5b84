"""Runs a script of CleanRL 1.2.0 with today's Gymnasium.

Its PPO was written for Gymnasium 0.28, its SAC for Gym 0.23. What differs is put in their way here;
the scripts themselves are the package's, unchanged.
"""

from __future__ import annotations

import functools
import runpy
import sys
import types
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rimless_gym  # noqa: F401  registers the environments


class Rows028(SyncVectorEnv):
    """Rows that are reset within the step, whose `final_info` is a list, None where none ended."""

    def __init__(self, thunks: Any) -> None:
        super().__init__(thunks, autoreset_mode=AutoresetMode.SAME_STEP)

    def step(self, actions: Any) -> Any:
        *results, infos = super().step(actions)
        if "final_info" in infos:
            ended, final = infos["_final_info"], infos["final_info"]
            infos["final_info"] = [
                {"episode": {key: values[i] for key, values in final["episode"].items()}}
                if ended[i]
                else None
                for i in range(self.num_envs)
            ]
        return *results, infos


class Rows023(Rows028):
    """The same with one `done`, a list of infos, and a reset that returns observations only."""

    def reset(self, **arguments: Any) -> Any:
        return super().reset(**arguments)[0]

    def step(self, actions: Any) -> Any:
        observations, rewards, terminated, truncated, infos = super().step(actions)
        each: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in (terminated | truncated).nonzero()[0]:
            each[i] = infos["final_info"][i] | {
                "terminal_observation": infos["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i]),
            }
        return observations, rewards, terminated | truncated, each


class Seeded023(gymnasium.Wrapper):
    """An environment with `seed(seed)`, which counts for the next reset."""

    _seed: int | None = None

    def seed(self, seed: int) -> None:
        self._seed = seed

    def reset(self, **arguments: Any) -> Any:
        seed, self._seed = self._seed, None
        return super().reset(**({"seed": seed} | arguments))


def gym_028() -> None:
    """Let `gymnasium` take what version 0.28 took."""
    transform = gymnasium.wrappers.TransformObservation
    gymnasium.wrappers.TransformObservation = functools.partial(  # type: ignore[misc]
        transform, observation_space=None
    )
    gymnasium.vector.SyncVectorEnv = Rows028  # type: ignore[misc]


def gym_023() -> types.ModuleType:
    """A module `gym` as far as the script uses it."""
    gym = types.ModuleType("gym")
    gym.make = lambda name: gymnasium.make(name)
    gym.spaces = gymnasium.spaces
    gym.vector = types.SimpleNamespace(SyncVectorEnv=Rows023)
    statistics = gymnasium.wrappers.RecordEpisodeStatistics
    gym.wrappers = types.SimpleNamespace(
        RecordEpisodeStatistics=lambda env: Seeded023(statistics(env))
    )
    return gym


def run(name: str, arguments: list[str]) -> dict[str, Any]:
    """Run a script, and give all names that it leaves behind."""
    gym_028()
    sys.modules["gym"] = gym_023()
    sys.argv = [name, *arguments]
    return runpy.run_module(f"cleanrl.{name}", run_name="__main__", alter_sys=True)
