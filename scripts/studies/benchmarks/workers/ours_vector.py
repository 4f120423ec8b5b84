"""Our native vector environment on a walking gait, with observations, rewards and infos."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from rimless_gym.equations import MODE_NAMES

from ..protocol import Measure, serve
from ..walks import PARAMS, load_walks


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Replay pieces of walks, one in each row. Resets are not timed."""
    n = settings["n"]
    walks = load_walks(Path(settings["folder"])).take(n)
    env = gym.make_vec("RimlessWheel-v0", num_envs=n, params=PARAMS)
    options = {"state": walks.starts, "mode": [MODE_NAMES[mode] for mode in walks.modes]}
    actions = list(walks.actions[:, :, None])

    def measure(seconds: float) -> dict[str, Any]:
        steps, elapsed, error, touchdowns = 0, 0.0, 0.0, 0
        while elapsed < seconds:
            env.reset(options=options)
            for action in actions:
                begin = time.perf_counter()
                observations, _, _, _, info = env.step(action)
                elapsed += time.perf_counter() - begin
                touchdowns += int(np.count_nonzero(info["touchdowns"]))
            steps += n * len(actions)
            error = max(error, walks.check_observations(observations))
        return {
            "steps": steps,
            "seconds": elapsed,
            "replay_error": error,
            "touchdowns": touchdowns / steps,
        }

    return measure, {"version": "rimless-gym"} | walks.about()


if __name__ == "__main__":
    serve(setup)
