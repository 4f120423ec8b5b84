"""EnvPool with the fastest of many settings, which are tried beforehand."""

from __future__ import annotations

import os
from importlib.metadata import version
from itertools import cycle
from statistics import median
from typing import Any

import envpool  # type: ignore[import-not-found]
import numpy as np

from ..protocol import Measure, serve, timed

#: (environments, batch); asynchronous if the batch is smaller.
SIZES = ((64, 64), (256, 256), (1024, 1024), (4096, 4096), (64, 32), (256, 128), (2048, 1024))

#: Rounds over all settings, and duration of each trial (s).
TRIALS, TRIAL = 3, 0.25


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Try all settings in several rounds, and keep the one with the best median."""
    cores = os.cpu_count() or 1
    tried = {
        (n, batch, threads): _measure(settings["env"], n, batch, threads)
        for n, batch in SIZES
        for threads in sorted({1, cores})
    }
    rates: dict[tuple[int, int, int], list[float]] = {key: [] for key in tried}
    for _ in range(TRIALS):
        for key, measure in tried.items():
            answer = measure(TRIAL)
            rates[key].append(answer["steps"] / answer["seconds"])
    best = max(rates, key=lambda key: median(rates[key]))
    return tried[best], {
        "version": f"envpool {version('envpool')}",
        "n": best[0],
        "settings": f"num_envs {best[0]}, batch_size {best[1]}, num_threads {best[2]}",
        "tried": [
            {"num_envs": n, "batch_size": batch, "num_threads": threads, "rates": list_}
            for (n, batch, threads), list_ in rates.items()
        ],
    }


def _measure(name: str, n: int, batch: int, threads: int) -> Measure:
    env = envpool.make(
        name, env_type="gymnasium", num_envs=n, batch_size=batch, num_threads=threads, seed=0
    )
    actions = cycle(_actions(env, batch))
    if batch == n:
        env.reset()

        def step() -> None:
            env.step(next(actions))
    else:
        env.async_reset()

        def step() -> None:
            env.send(next(actions), env.recv()[-1]["env_id"])

    def chunk() -> int:
        for _ in range(max(1, 1000 // batch)):
            step()
        return batch * max(1, 1000 // batch)

    return lambda seconds: timed(chunk, seconds)


def _actions(env: Any, batch: int) -> list[Any]:
    rng, space = np.random.default_rng(0), env.action_space
    if hasattr(space, "n"):
        return [rng.integers(0, space.n, batch).astype(np.int32) for _ in range(64)]
    return [rng.uniform(space.low, space.high, (batch, *space.shape)) for _ in range(64)]


if __name__ == "__main__":
    serve(setup)
