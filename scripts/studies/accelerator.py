"""The study `accelerator`: speed and accuracy of `rimless_gym.jax` on the accelerator at hand.

Intervals of 10 ms, in random play and on walks, are advanced there and by the compiled simulator on
all cores of the same machine.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.cli.options import Count
from rimless_gym.checks import extra
from rimless_gym.energy import ROW
from rimless_gym.envs.starts import draw_start
from rimless_gym.kernel.stepping import HybridState, advance, hybrid_states
from rimless_gym.presets import preset
from scripts.studies.benchmark.ours import PRESET, load_walks

Floats = NDArray[np.float64]
Intervals = tuple[Floats, Floats]  # hybrid states (N, 6) at their beginnings, voltages (N,)

FOLDER = Path("runs", "bench")
DIFFERENT = 4096  # intervals; batches repeat them
LEAST = 1.0  # seconds of a measurement


def accelerator(*, rows: Count = 10**6, out: Path = FOLDER) -> int:
    """Measure intervals per second, and the largest differences from the compiled simulator.

    Walks are recorded the first time; that needs CasADi. A machine without it can be given the
    file walks_128.npz.

    Args:
        rows: that are advanced at once.
        out: folder for accelerator.json.
    """
    with extra("jax"):
        import jax

        from rimless_gym.jax import WheelEnv
    out.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_enable_x64", True)
    device, cores = jax.devices()[0].device_kind, len(os.sched_getaffinity(0))
    about = {"device": device, "jax": jax.__version__, "cores": cores, "rows": rows}
    print(about)
    results: list[dict[str, Any]] = []
    for motion, given in {"walks": walks(out), "random": played()}.items():
        fast = kernel_speed(given, rows, cores)
        results.append({"motion": motion, "by": "kernel", "per_second": fast})
        for dtype in ("float32", "float64"):
            found = measured(WheelEnv(params=PRESET, dtype=dtype), given, rows)
            results.append({"motion": motion, "by": dtype} | found)
        print(*results[-3:], sep="\n", flush=True)
    (out / "accelerator.json").write_text(json.dumps(about | {"results": results}, indent=1))
    return 0


def walks(folder: Path) -> Intervals:
    """Intervals of recorded walks, which an LQR holds on the gait."""
    recorded, limit = load_walks(folder), preset(PRESET).voltage_limit
    walking, states = hybrid_states(recorded.starts, 0), []
    for actions in recorded.actions:
        states.append(walking.copy())
        advance(preset(PRESET), walking, actions * limit)
    some = np.random.default_rng(0).choice(recorded.actions.size, DIFFERENT, replace=False)
    volts = recorded.actions.ravel()[some].astype(np.float64) * limit
    return folded(np.concatenate(states)[some]), volts


def played() -> Intervals:
    """Intervals after a second of random play, in which most wheels stand or rock."""
    machine, rng = preset(PRESET), np.random.default_rng(0)
    states = np.stack([draw_start(machine, rng) for _ in range(DIFFERENT)])
    for _ in range(10):
        volts = rng.uniform(-1, 1, DIFFERENT) * machine.voltage_limit
        for _ in range(10):
            for row in np.flatnonzero(advance(machine, states, volts)[:, ROW.failure]):
                states[row] = draw_start(machine, rng)
    return folded(states), rng.uniform(-1, 1, DIFFERENT) * machine.voltage_limit


def folded(states: Floats) -> Floats:
    """The states with theta between -pi and pi, and the steps counted from 0."""
    states[:, 1] -= 2 * np.pi * np.round(states[:, 1] / (2 * np.pi))
    states[:, 5] = 0
    return states


def measured(env: Any, given: Intervals, rows: int) -> dict[str, Any]:
    """Intervals per second, seconds of compiling, and the largest differences from the kernel."""
    import jax
    import jax.numpy as jnp

    states, volts = (x.astype(env.dtype).astype(np.float64) for x in given)
    index = np.arange(rows) % DIFFERENT
    angles = [jnp.asarray(x, env.dtype) for x in states[index].T[:4]]
    wheel = HybridState(*angles, *(jnp.asarray(x, jnp.int32) for x in states[index].T[4:]))
    _, state = env.reset(jax.random.key(0))
    step = jax.vmap(lambda wheel, u: env.interval(state._replace(wheel=wheel), u))
    arrays = wheel, jnp.asarray(volts[index], env.dtype)
    begin = time.perf_counter()
    program = jax.jit(step).lower(*arrays).compile()
    compiling = time.perf_counter() - begin
    wheel, totals = program(*arrays)
    fast = per_second(lambda: jax.block_until_ready(program(*arrays)), rows)

    known = advance(preset(PRESET), states, volts)
    n = min(rows, DIFFERENT)
    found = np.stack([np.asarray(x[:n], np.float64) for x in wheel], axis=1)
    other = np.any(found[:, 4:] != states[:n, 4:], axis=1)
    for name in ("failure", "touchdowns", "steps"):
        other |= np.asarray(getattr(totals, name)[:n]) != known[:n, getattr(ROW, name)]

    def most(found: Any, known: Floats) -> float:
        return float(np.abs(np.asarray(found[:n]) - known[:n])[~other].max())

    differences = {
        name: most(getattr(totals, name), known[:, getattr(ROW, name)])
        for name in ("touchdown_time", "electrical_positive")
    }
    differences["state"] = most(found[:, :4], folded(states)[:, :4])
    return {"per_second": fast, "compile": compiling, "disagree": int(other.sum()), **differences}


def kernel_speed(given: Intervals, rows: int, cores: int) -> float:
    """Intervals per second of the compiled simulator, without the environment around it."""
    index = np.array_split(np.arange(rows) % DIFFERENT, cores)
    states, volts = given
    parts = [(states[i], volts[i]) for i in index]

    def part(states: Floats, volts: Floats) -> None:
        advance(preset(PRESET), states.copy(), volts)

    part(*parts[0])  # compiles
    with ThreadPoolExecutor(cores) as pool:
        return per_second(lambda: list(pool.map(part, *zip(*parts, strict=True))), rows)


def per_second(call: Callable[[], Any], rows: int) -> float:
    """Rows per second of calls that advance so many."""
    begin, calls, spent = time.perf_counter(), 0, 0.0
    while spent < LEAST:
        call()
        calls, spent = calls + 1, time.perf_counter() - begin
    return calls * rows / spent
