"""A single Gymnasium environment, exactly as `gym.make` gives it."""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import gymnasium as gym

from ..protocol import Measure, serve

N_ACTIONS = 4096


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Random actions are drawn beforehand. Resets are not timed, as in our own worker."""
    env = gym.make(settings["env"])
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(N_ACTIONS)]
    env.reset(seed=0)

    def measure(seconds: float) -> dict[str, Any]:
        steps, elapsed, i = 0, 0.0, 0
        while elapsed < seconds:
            env.reset()
            ended = False
            begin = time.perf_counter()
            while not ended:
                _, _, terminated, truncated, _ = env.step(actions[i])
                ended = terminated or truncated
                i = (i + 1) % N_ACTIONS
                steps += 1
            elapsed += time.perf_counter() - begin
        return {"steps": steps, "seconds": elapsed}

    return measure, {"version": f"gymnasium {version('gymnasium')}"} | _mujoco(settings["env"])


def _mujoco(name: str) -> dict[str, Any]:
    return {"physics_version": f"mujoco {version('mujoco')}"} if name.endswith("-v5") else {}


if __name__ == "__main__":
    serve(setup)
