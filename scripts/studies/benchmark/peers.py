"""Steps per second of other people's environments: `python peers.py SETTINGS` prints one answer.

Each peer runs in a virtual environment of its own, so this file imports only what it measures.
Random actions are drawn beforehand. EnvPool and gymnax have the settings that were fastest on two
cores, of seven sizes with one and two threads, and of scans of 1, 16 and 100 steps.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from itertools import cycle
from typing import Any


def main() -> None:
    """Measure what the settings name, for about so many seconds, and print the answer as JSON."""
    settings = json.loads(sys.argv[1])
    measure: Any = MEASURES[settings.pop("measure")]
    print(json.dumps(measure(**settings)))


def gymnasium_single(seconds: float, env: str) -> dict[str, Any]:
    """One environment, exactly as `gym.make` gives it. Resets are not timed."""
    import gymnasium as gym

    made = gym.make(env)
    made.action_space.seed(0)
    actions = cycle([made.action_space.sample() for _ in range(4096)])
    made.reset(seed=0)
    steps, elapsed = 0, 0.0
    while elapsed < seconds:
        made.reset()
        ended = False
        begin = time.perf_counter()
        while not ended:
            _, _, terminated, truncated, _ = made.step(next(actions))
            ended = terminated or truncated
            steps += 1
        elapsed += time.perf_counter() - begin
    physics = {"physics_version": f"mujoco {version('mujoco')}"} if env.endswith("-v5") else {}
    return answer("gymnasium", steps=steps, seconds=elapsed, **physics)


def gymnasium_vector(seconds: float, env: str, n: int) -> dict[str, Any]:
    """Gymnasium's native vector environment, which resets its rows by itself."""
    import gymnasium as gym
    import numpy as np

    envs = gym.make_vec(env, num_envs=n, vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = cycle([rng.integers(0, 2, n) for _ in range(64)])

    def chunk() -> int:
        for _ in range(10):
            envs.step(next(actions))
        return 10 * n

    return answer("gymnasium", **repeated(chunk, seconds))


def envpool_vector(seconds: float, env: str, n: int, batch: int) -> dict[str, Any]:
    """EnvPool on all cores, asynchronous: a step is one of `batch` rows."""
    import envpool  # type: ignore[import-not-found]
    import numpy as np

    made = envpool.make(
        env,
        env_type="gymnasium",
        num_envs=n,
        batch_size=batch,
        num_threads=os.cpu_count() or 1,
        seed=0,
    )
    rng, number = np.random.default_rng(0), made.action_space.n
    actions = cycle([rng.integers(0, number, batch).astype(np.int32) for _ in range(64)])
    made.async_reset()

    def chunk() -> int:
        made.send(next(actions), made.recv()[-1]["env_id"])
        return batch

    return answer("envpool", **repeated(chunk, seconds))


def gymnax_vector(seconds: float, env: str, n: int) -> dict[str, Any]:
    """gymnax on the CPU, one step in a call of a compiled function."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    import gymnax  # type: ignore[import-not-found]
    import jax

    made, params = gymnax.make(env)
    step = jax.vmap(made.step, in_axes=(0, 0, 0, None))

    @jax.jit
    def run(key: Any, state: Any, action: Any) -> Any:
        key, draw = jax.random.split(key)
        observation, state, reward, done, *_ = step(
            jax.random.split(draw, n), state, action, params
        )
        # The sums force everything to be computed without keeping all of it.
        return key, state, (observation.sum(), reward.sum(), done.sum())

    keys = jax.random.split(jax.random.key(0), n)
    _, state = jax.jit(jax.vmap(made.reset, in_axes=(0, None)))(keys, params)
    action = jax.random.randint(jax.random.key(1), (n,), 0, made.num_actions)
    key, state, _ = jax.block_until_ready(run(jax.random.key(2), state, action))

    def chunk() -> int:
        nonlocal key, state
        for _ in range(100):
            key, state, sums = run(key, state, action)
        jax.block_until_ready((state, sums))
        return 100 * n

    return answer("gymnax", **repeated(chunk, seconds), jax_version=f"jax {version('jax')}")


def repeated(chunk: Callable[[], int], seconds: float) -> dict[str, Any]:
    """Repeat `chunk`, which returns how many steps it took, after a while of warming up."""
    steps = 0
    for duration in (0.3, seconds):
        steps, begin = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - begin) < duration or steps == 0:
            steps += chunk()
    return {"steps": steps, "seconds": elapsed}


def answer(package: str, **figures: Any) -> dict[str, Any]:
    """What is printed: the figures and the package's version."""
    return {"version": f"{package} {version(package)}", **figures}


MEASURES = {
    "gymnasium_single": gymnasium_single,
    "gymnasium_vector": gymnasium_vector,
    "envpool_vector": envpool_vector,
    "gymnax_vector": gymnax_vector,
}

if __name__ == "__main__":
    main()
