"""Our stepping kernel without Gymnasium, observations and rewards, on a walking gait.

Python makes one compiled call for each control interval of all rows. For a single row the call
itself takes a good part of the time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import MODE, STATE_SIZE, advance_batch, scratch

from ..protocol import Measure, serve
from ..walks import PARAMS, WINDOW, Floats, Walks, load_walks


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Replay pieces of walks. Setting the states is not timed."""
    walks = load_walks(Path(settings["folder"]))
    replay = _replayer(walks.take(settings["n"]))

    def measure(seconds: float) -> dict[str, Any]:
        steps, elapsed, error = 0, 0.0, 0.0
        while elapsed < seconds:
            taken, spent, off = replay()
            steps, elapsed, error = steps + taken, elapsed + spent, max(error, off)
        return {"steps": steps, "seconds": elapsed, "replay_error": error}

    return measure, {"version": "rimless-gym"} | walks.about()


def _replayer(walks: Walks) -> Callable[[], tuple[int, float, float]]:
    """A function that replays all pieces side by side: steps, seconds, and the error at the end."""
    constants, work = PARAMS.constants_array[:, None].copy(), scratch()
    poles = np.array([PARAMS.motor_pole])
    voltages = PARAMS.voltage_limit * walks.actions.astype(np.float64)
    out = np.empty((len(ROW), len(walks.starts)))

    def replay() -> tuple[int, float, float]:
        x = _states(walks)
        begin = time.perf_counter()
        for u in voltages:
            advance_batch(constants, poles, x, u, 0, len(u), CONTROL_PERIOD, 0.0, out, work)
        return x.shape[1] * WINDOW, time.perf_counter() - begin, walks.check(x[:4].T)

    return replay


def _states(walks: Walks) -> Floats:
    """Hybrid states (STATE_SIZE, M) at the start."""
    x = np.zeros((STATE_SIZE, len(walks.starts)))
    x[:4], x[MODE] = walks.starts.T, walks.modes
    return x


if __name__ == "__main__":
    serve(setup)
