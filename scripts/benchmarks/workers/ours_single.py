"""Our environment, exactly as `gym.make` gives it, on a walking gait."""

from __future__ import annotations

import time
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium as gym

from rimless_gym.hybrid import MODE_NAMES
from scripts.benchmarks.protocol import Measure, serve
from scripts.benchmarks.walks import PARAMS, load_walks


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Replay one piece of a walk after the other; each is put in place outside the clock."""
    walks = load_walks(Path(settings["folder"]))
    env = gym.make("RimlessWheel-v0", params=PARAMS)
    replays = count()

    def measure(seconds: float) -> dict[str, Any]:
        steps, elapsed, error, touchdowns = 0, 0.0, 0.0, 0
        while elapsed < seconds:
            i = next(replays) % len(walks.starts)
            options = {"state": walks.starts[i], "mode": MODE_NAMES[walks.modes[i]]}
            env.reset(options=options)
            actions = list(walks.actions[:, i : i + 1])
            begin = time.perf_counter()
            for action in actions:
                _, _, _, _, info = env.step(action)
                touchdowns += info["touchdowns"]
            elapsed += time.perf_counter() - begin
            steps += len(actions)
            end: Any = env.unwrapped
            error = max(error, walks.piece(i).check(end.state[None, :4]))
        return {
            "steps": steps,
            "seconds": elapsed,
            "replay_error": error,
            "touchdowns": touchdowns / steps,
        }

    return measure, {"version": "rimless-gym"} | walks.about()


if __name__ == "__main__":
    serve(setup)
