"""The study `accelerator`: speed and accuracy of `rimless_gym.jax` on the accelerator at hand.

Intervals of 10 ms, in random play and on walks, are advanced there, by the compiled simulator on
all cores of the same machine, by MJX if it is installed (MuJoCo in JAX, with the wheel of
`rimless_gym.export`), and in training by rejax's PPO if that is installed.
"""

from __future__ import annotations

import importlib.util
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.cli.options import MaybeCount, MaybePath
from rimless_gym.checks import extra
from rimless_gym.energy import ROW
from rimless_gym.envs.starts import draw_start
from rimless_gym.export import TIMESTEP, joint_state, to_mjcf
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import HybridState, advance, hybrid_states
from rimless_gym.presets import preset
from scripts.studies.benchmark.ours import PRESET, load_walks
from scripts.studies.documents import markdown

Floats = NDArray[np.float64]
Intervals = tuple[Floats, Floats]  # hybrid states (N, 6) at their beginnings, voltages (N,)

FOLDER = Path("runs", "bench")
DIFFERENT = 4096  # intervals; batches repeat them
LEAST = 1.0  # seconds of a measurement
SHARE = 256  # of the rows, one in so many in MJX, which is that much slower, and in training
PPO = {"num_steps": 32, "num_epochs": 3, "num_minibatches": 16}  # of rejax; networks of 64 x 64

MARKS = markdown.marks("accelerator", ("speed",))


def accelerator(*, rows: MaybeCount = None, out: Path = FOLDER, docs: MaybePath = None) -> int:
    """Measure intervals per second, and the largest differences from the compiled simulator.

    Walks are recorded the first time, which needs CasADi, or are those of walks_128.npz in `out`.

    Args:
        rows: at most that are advanced at once; by default 4096 on a CPU, and elsewhere 4 million,
            half and a quarter of them.
        out: folder for accelerator.json.
        docs: a page, docs/environment.md, to put the table into; accelerator.json goes beside it.
    """
    found = measured_here(rows, out)
    if docs:
        docs.with_name("accelerator.json").write_text(json.dumps(found, indent=1) + "\n")
        markdown.refresh(docs, MARKS, {"speed": table(found)})
    print(table(found))
    return 0


def measured_here(most: int | None, out: Path) -> dict[str, Any]:
    """What the accelerator at hand does, and what the compiled simulator does beside it."""
    with extra("jax"):
        import jax

        from rimless_gym.jax import WheelEnv
    out.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_enable_x64", True)
    on_cpu, cores = jax.default_backend() == "cpu", len(os.sched_getaffinity(0))
    rows = most or (DIFFERENT if on_cpu else 2**22)
    motions, results = {"walks": walks(out), "random": played()}, list[dict[str, Any]]()
    found = {
        "device": jax.devices()[0].device_kind,
        "jax": jax.__version__,
        "cores": cores,
        "bandwidth": bandwidth(rows),
        "results": results,
    }

    def keep(
        by: str, count: int, figures: Iterable[dict[str, Any]], motions: Iterable[str] = motions
    ) -> None:
        for motion, of_motion in zip(motions, figures, strict=True):
            results.append({"motion": motion, "by": by, "rows": count} | of_motion)
            print(results[-1], flush=True)
        (out / "accelerator.json").write_text(json.dumps(found, indent=1))

    given = list(motions.values())
    keep("kernel", rows, ({"per_second": kernel_speed(each, rows, cores)} for each in given))
    for dtype in ("float32", "float64"):
        for count in (rows,) if on_cpu else (rows // 4, rows // 2, rows):
            keep(dtype, count, measured(WheelEnv(params=PRESET, dtype=dtype), given, count))
    count = max(1, rows // SHARE)
    if importlib.util.find_spec("mujoco") and importlib.util.find_spec("mujoco.mjx"):
        keep("mjx", count, ({"per_second": each} for each in mjx_speeds(given, count)))
    if importlib.util.find_spec("rejax"):
        keep("ppo", count, [{"per_second": ppo_speed(count)}], ["random"])
    return found


def table(found: dict[str, Any]) -> str:
    """The table of the page, and what limits the speed."""
    cells: dict[tuple[str, int], dict[str, str]] = {}
    for one in found["results"]:
        row = cells.setdefault((one["by"], one["rows"]), {"walks": ""})
        row[one["motion"]] = markdown.count(one["per_second"])
    titles = {
        "kernel": f"compiled simulator, {found['cores']} cores",
        "float32": "float32, RK4",
        "float64": "float64, DOP853",
        "mjx": f"MJX, float32, steps of {1000 * TIMESTEP:g} ms",
        "ppo": "float32 and PPO of rejax: {num_epochs} epochs of {num_minibatches} batches after "
        "{num_steps} steps, networks of 64 x 64; learning included".format_map(PPO),
    }
    rows = [[titles[by], f"{n:,}", *cell.values()] for (by, n), cell in cells.items()]
    head = ["", "rows at once", "walks (1/s)", "random play (1/s)"]
    if found["device"] == "cpu":  # its caches are not in XLA's count
        return markdown.table(head, rows) + "\n"
    most = [one for one in found["results"] if one["by"] == "float32"][-1]
    flops, size = (most[name] / most["rows"] for name in ("flops", "bytes"))
    limit = (
        f"{found['device']}, jax {found['jax']}. In float32 an attempt at a step is "
        f"{flops / 1e3:.1f} kflop and moves {size / 1e3:.1f} kB (XLA's count). Doubling an array "
        f"moved {found['bandwidth'] / 1e12:.1f} TB/s beside it, which allows "
        f"{markdown.count(found['bandwidth'] / size)} attempts per second, and an interval takes "
        "two to four: memory is the limit, not arithmetic."
    )
    return f"{markdown.table(head, rows)}\n\n{limit}\n"


def bandwidth(rows: int) -> float:
    """Bytes per second, read and written, of doubling an array."""
    import jax
    import jax.numpy as jnp

    array = jnp.ones(64 * rows, jnp.float32)
    double = jax.jit(lambda x: 2 * x).lower(array).compile()
    return 2 * per_second(lambda: jax.block_until_ready(double(array)), array.nbytes)


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


def measured(env: Any, motions: Sequence[Intervals], rows: int) -> Iterator[dict[str, Any]]:
    """Intervals per second, seconds of compiling, and the largest differences from the kernel."""
    import jax
    import jax.numpy as jnp

    from rimless_gym.jax import compiler_options

    index, n = np.arange(rows) % DIFFERENT, min(rows, DIFFERENT)
    _, state = env.reset(jax.random.key(0))
    step = jax.jit(jax.vmap(lambda wheel, u: env.interval(state._replace(wheel=wheel), u)))
    program, compiling = None, 0.0
    for given in motions:
        states, volts = (x.astype(env.dtype).astype(np.float64) for x in given)
        angles = [jnp.asarray(x, env.dtype) for x in states[index].T[:4]]
        wheel = HybridState(*angles, *(jnp.asarray(x, jnp.int32) for x in states[index].T[4:]))
        arrays = wheel, jnp.asarray(volts[index], env.dtype)
        if program is None:
            begin = time.perf_counter()
            program = step.lower(*arrays).compile(compiler_options())
            compiling = time.perf_counter() - begin
        wheel, totals = program(*arrays)
        known = advance(preset(PRESET), states, volts)
        found = np.stack([np.asarray(x[:n], np.float64) for x in wheel], axis=1)
        other = np.any(found[:, 4:] != states[:n, 4:], axis=1)
        for name in ("failure", "touchdowns", "steps"):
            other |= np.asarray(getattr(totals, name)[:n]) != known[:n, getattr(ROW, name)]
        differences = {
            name: np.abs(np.asarray(getattr(totals, name)[:n]) - known[:n, getattr(ROW, name)])
            for name in ("touchdown_time", "electrical_positive")
        }
        differences["state"] = np.abs(folded(found - states[:n])[:, :4])
        cost = program.cost_analysis()
        yield {
            "per_second": per_second(lambda: jax.block_until_ready(program(*arrays)), rows),  # noqa: B023
            "flops": cost["flops"],
            "bytes": cost["bytes accessed"],
            "compile": compiling,
            "disagree": int(other.sum()),
            **{name: float(each[~other].max()) for name, each in differences.items()},
        }


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


def mjx_speeds(motions: Sequence[Intervals], rows: int) -> Iterator[float]:
    """Intervals per second of MuJoCo in JAX, whose steps are as short as touchdowns need them."""
    import jax
    import jax.numpy as jnp
    import mujoco
    from mujoco import mjx

    machine, index = preset(PRESET), np.arange(rows) % DIFFERENT
    model = mujoco.MjModel.from_xml_string(to_mjcf(machine))
    steps = round(CONTROL_PERIOD / model.opt.timestep)
    with jax.enable_x64(False):
        system, begin = mjx.put_model(model), mjx.put_data(model, mujoco.MjData(model))

        @jax.jit
        @jax.vmap
        def interval(position: Any, rate: Any, u: Any) -> Any:
            data = begin.replace(qpos=position, qvel=rate, ctrl=u)
            end = jax.lax.fori_loop(0, steps, lambda _, x: mjx.step(system, x), data)
            return end.qpos, end.qvel

        for given in motions:
            states, volts = (x[index] for x in given)
            arrays = [
                jnp.asarray(x) for x in (*joint_state(machine, states[:, :4]), volts[:, None])
            ]
            jax.block_until_ready(interval(*arrays))  # compiles
            yield per_second(lambda: jax.block_until_ready(interval(*arrays)), rows)  # noqa: B023


def ppo_speed(rows: int) -> float:
    """Decisions per second of training from scratch, in which wheels are played at random."""
    import jax
    import rejax

    from rimless_gym.jax import EnvParams, RejaxEnv, compiler_options

    with jax.enable_x64(False):
        env = RejaxEnv(params=PRESET)
        ppo = rejax.PPO.create(env=env, env_params=EnvParams(), num_envs=rows, **PPO)
        iterate = jax.jit(ppo.train_iteration, compiler_options=compiler_options())
        state = iterate(ppo.init_state(jax.random.key(0)))  # compiles

        def iteration() -> None:
            nonlocal state
            state = jax.block_until_ready(iterate(state))

        return per_second(iteration, rows * PPO["num_steps"])


def per_second(call: Callable[[], Any], rows: int) -> float:
    """Rows per second of calls that advance so many."""
    begin, calls, spent = time.perf_counter(), 0, 0.0
    while spent < LEAST:
        call()
        calls, spent = calls + 1, time.perf_counter() - begin
    return calls * rows / spent
