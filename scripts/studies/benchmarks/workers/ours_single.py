"""Our environment, exactly as `gym.make` gives it, on a walking gait.

Its info is made when it is first read. The peers' info is not read, so ours is read only with the
setting `read_info`.
"""

from __future__ import annotations

import time
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium as gym

from rimless_gym.equations import MODE_NAMES

from ..protocol import Measure, serve
from ..walks import PARAMS, load_walks


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Replay one piece of a walk after the other. Resets are not timed."""
    walks = load_walks(Path(settings["folder"]))
    env = gym.make("RimlessWheel-v0", params=PARAMS)
    play, replays = _play_reading if settings.get("read_info") else _play, count()

    def measure(seconds: float) -> dict[str, Any]:
        steps, elapsed, error = 0, 0.0, 0.0
        while elapsed < seconds:
            i = next(replays) % len(walks.starts)
            options = {"state": walks.starts[i], "mode": MODE_NAMES[walks.modes[i]]}
            env.reset(options=options)
            actions = list(walks.actions[:, i : i + 1])
            begin = time.perf_counter()
            play(env, actions)
            elapsed += time.perf_counter() - begin
            steps += len(actions)
            end: Any = env.unwrapped
            error = max(error, walks.piece(i).check(end.state[None, :4]))
        return {"steps": steps, "seconds": elapsed, "replay_error": error}

    return measure, {"version": "rimless-gym"} | walks.about()


def _play(env: Any, actions: list[Any]) -> None:
    for action in actions:
        env.step(action)


def _play_reading(env: Any, actions: list[Any]) -> None:
    for action in actions:
        env.step(action)[4]["touchdowns"]


if __name__ == "__main__":
    serve(setup)
