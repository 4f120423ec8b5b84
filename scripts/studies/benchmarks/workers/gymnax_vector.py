"""gymnax on the CPU: many steps under one `jit`, with the fastest of some lengths of the scan."""

from __future__ import annotations

import os

os.environ["JAX_PLATFORMS"] = "cpu"

from importlib.metadata import version
from statistics import median
from typing import Any

import gymnax  # type: ignore[import-not-found]
import jax

from ..protocol import Measure, serve, timed

LENGTHS = (1, 16, 100)
TRIALS, TRIAL = 3, 0.5


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Try all lengths in several rounds, and keep the one with the best median."""
    env, params = gymnax.make(settings["env"])
    tried = {length: _measure(env, params, settings["n"], length) for length in LENGTHS}
    rates: dict[int, list[float]] = {length: [] for length in tried}
    for _ in range(TRIALS):
        for length, measure in tried.items():
            answer = measure(TRIAL)
            rates[length].append(answer["steps"] / answer["seconds"])
    best = max(rates, key=lambda length: median(rates[length]))
    return tried[best], {
        "version": f"gymnax {version('gymnax')}, jax {version('jax')}",
        "settings": f"float32, {best} steps per call",
        "tried": [{"length": length, "rates": list_} for length, list_ in rates.items()],
    }


def _measure(env: Any, params: Any, n: int, length: int) -> Measure:
    step = jax.vmap(env.step, in_axes=(0, 0, 0, None))

    @jax.jit
    def run(key: Any, state: Any, actions: Any) -> Any:
        def body(carry: Any, action: Any) -> Any:
            key, draw = jax.random.split(carry[0])
            observation, state, reward, done, *_ = step(
                jax.random.split(draw, n), carry[1], action, params
            )
            # The sums force everything to be computed without keeping all of it.
            return (key, state), (observation.sum(), reward.sum(), done.sum())

        return jax.lax.scan(body, (key, state), actions)

    keys = jax.random.split(jax.random.key(0), n)
    _, state = jax.jit(jax.vmap(env.reset, in_axes=(0, None)))(keys, params)
    actions = jax.random.randint(jax.random.key(1), (length, n), 0, env.num_actions)
    carry = jax.block_until_ready(run(jax.random.key(2), state, actions))[0]

    def chunk() -> int:
        nonlocal carry
        calls = max(1, 100 // length)
        for _ in range(calls):
            carry, sums = run(*carry, actions)
        jax.block_until_ready((carry, sums))
        return n * length * calls

    return lambda seconds: timed(chunk, seconds)


if __name__ == "__main__":
    serve(setup)
