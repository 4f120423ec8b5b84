"""Gymnasium's native vector environment."""

from __future__ import annotations

from importlib.metadata import version
from itertools import cycle
from typing import Any

import gymnasium as gym
import numpy as np

from ..protocol import Measure, serve, timed


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Random actions are drawn beforehand. The environment resets its rows by itself."""
    n = settings["n"]
    env = gym.make_vec(settings["env"], num_envs=n, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = cycle([rng.integers(0, 2, n) for _ in range(64)])

    def chunk() -> int:
        for _ in range(10):
            env.step(next(actions))
        return 10 * n

    def measure(seconds: float) -> dict[str, Any]:
        return timed(chunk, seconds)

    return measure, {"version": f"gymnasium {version('gymnasium')}"}


if __name__ == "__main__":
    serve(setup)
