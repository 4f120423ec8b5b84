"""Speed and accuracy of this package: `python -m scripts.studies.benchmark.ours SETTINGS`.

The environments replay recorded walks: states on an optimal gait that an LQR stabilises, and the
LQR's actions. That times the simulator without the LQR, on the motion that matters. Without
feedback a gait is unstable, so replays are short: after 2 s, simulators that agree to rounding
error still walk alike.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scripts.studies.benchmark import swing_up

Floats = NDArray[np.float64]

#: The machine and the gait that is walked.
PRESET, SPEED, STEPS = "BUILDABLE", 0.5, 1

#: How many walks are recorded, and how many control intervals of each, after so many that are not.
WALKS, SETTLING, RECORDED = 128, 1000, 2000

#: Control intervals of one replay, 2 s.
WINDOW = 200

#: Largest difference between states of a replay and the recorded ones (rad, rad/s). A missed or
#: wrong touchdown makes more than a tenth.
TOLERANCE = 1e-4

#: Programs that a fresh process runs; each prints the seconds that it took.
PROGRAMS = {
    "import": """
import time; begin = time.perf_counter()
import rimless_gym
print(time.perf_counter() - begin)""",
    "single": """
import time; begin = time.perf_counter()
import gymnasium, rimless_gym
env = gymnasium.make("RimlessWheel-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - begin)""",
    "vector": """
import time; begin = time.perf_counter()
import gymnasium, rimless_gym
env = gymnasium.make_vec("RimlessWheel-v0", num_envs=64)
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - begin)""",
    # Imports are not counted, but anything that is compiled or loaded later is.
    "gait": """
import time
from trajopt import periodic_gait
begin = time.perf_counter()
assert periodic_gait("BUILDABLE", speed=0.5, steps=2).verification.passed
print(time.perf_counter() - begin)""",
}


class Walks(NamedTuple):
    """M pieces of walks, each `WINDOW` control intervals long.

    Attributes:
        starts: phi, theta, phi', theta', (M, 4).
        modes: stance modes at the start, (M,), numbered as in `rimless_gym.hybrid`.
        actions: as the environment takes them, (WINDOW, M) float32.
        ends: states (M, 4) after the last interval.
    """

    starts: Floats
    modes: NDArray[np.int64]
    actions: NDArray[np.float32]
    ends: Floats

    def pieces(self, index: Any) -> Walks:
        """The pieces of these numbers."""
        actions = np.ascontiguousarray(self.actions[:, index])
        return Walks(self.starts[index], self.modes[index], actions, self.ends[index])

    def checked(self, difference: Any) -> float:
        """The largest difference of a replay from the recorded end.

        Raises:
            RuntimeError: it is above `TOLERANCE`, so the replay was not this walk.
        """
        largest = float(np.abs(difference).max())
        if not largest <= TOLERANCE:
            raise RuntimeError(f"the replay left the recorded walk by {largest:.3g}")
        return largest


def main() -> None:
    """Measure what the settings name, for about so many seconds, and print the answer as JSON."""
    settings = json.loads(sys.argv[1])
    measure: Any = MEASURES[settings.pop("measure")]
    print(json.dumps({"version": "rimless-gym", **measure(**settings)}))


def single(seconds: float, folder: str) -> dict[str, Any]:
    """One environment, exactly as `gym.make` gives it. Resets are not timed."""
    import gymnasium as gym

    from rimless_gym.equations import MODE_NAMES

    walks = load_walks(Path(folder))
    env: Any = gym.make("RimlessWheel-v0", params=PRESET)
    error, replays = 0.0, count()
    for duration in (0.3, seconds):  # the first warms up
        steps, elapsed = 0, 0.0
        while elapsed < duration:
            i = next(replays) % len(walks.starts)
            env.reset(options={"state": walks.starts[i], "mode": MODE_NAMES[walks.modes[i]]})
            actions = list(walks.actions[:, i : i + 1])
            begin = time.perf_counter()
            for action in actions:
                env.step(action)
            elapsed += time.perf_counter() - begin
            steps += len(actions)
            error = max(error, walks.checked(env.unwrapped.state[:4] - walks.ends[i]))
    return {"steps": steps, "seconds": elapsed, "replay_error": error}


def vector(seconds: float, folder: str, n: int) -> dict[str, Any]:
    """The native vector environment, with observations, rewards and infos. Resets are not timed."""
    import gymnasium as gym

    from rimless_gym.equations import MODE_NAMES

    walks = load_walks(Path(folder))
    walks = walks.pieces(np.arange(n) % len(walks.starts))
    env: Any = gym.make_vec("RimlessWheel-v0", num_envs=n, params=PRESET)
    options = {"state": walks.starts, "mode": [MODE_NAMES[mode] for mode in walks.modes]}
    actions, error = list(walks.actions[:, :, None]), 0.0
    for duration in (0.3, seconds):
        steps, elapsed = 0, 0.0
        while elapsed < duration:
            env.reset(options=options)
            begin = time.perf_counter()
            for action in actions:
                env.step(action)
            elapsed += time.perf_counter() - begin
            steps += n * len(actions)
            error = max(error, walks.checked(env.unwrapped.states[:, :4] - walks.ends))
    return {
        "steps": steps,
        "seconds": elapsed,
        "replay_error": error,
    }


def optimisation(seconds: float, folder: str) -> dict[str, Any]:
    """Kelly's cart-pole: the problem is built, and solved on one mesh."""
    from scripts.studies.textbook import cart_pole
    from trajopt.ocp.guesses import straight_lines
    from trajopt.ocp.mesh import Mesh
    from trajopt.ocp.transcription import Transcription

    def once() -> dict[str, float]:
        begin = time.perf_counter()
        problem = cart_pole()
        mesh = Mesh.uniform(problem, elements=swing_up.SEGMENTS, scheme="hermite-simpson")
        transcription = Transcription(problem, mesh)
        transcription.solver()
        built = time.perf_counter()
        result = transcription.solve(straight_lines(problem))
        return {
            "build": built - begin,
            "solve": time.perf_counter() - built,
            "iterations": result.iterations,
            "cost": result.cost,
        }

    return swing_up.repeated(once, seconds)


def fresh(seconds: float, folder: str, program: str, cold: bool = False) -> dict[str, Any]:
    """A fresh process, however long it takes; a cold one has nothing compiled."""
    with tempfile.TemporaryDirectory() as empty:
        run = subprocess.run(
            [sys.executable, "-c", PROGRAMS[program]],
            env=os.environ | ({"NUMBA_CACHE_DIR": empty} if cold else {}),
            capture_output=True,
            text=True,
            check=False,
        )
    if run.returncode:
        raise RuntimeError(run.stderr.strip().splitlines()[-1])
    return {"steps": 1, "seconds": float(run.stdout)}


def accuracy(seconds: float, folder: str) -> dict[str, Any]:
    """How far the stepping kernel is from the reference simulator over pieces of 2 s."""
    errors: list[Any] = []
    walks = load_walks(Path(folder))
    begin = time.perf_counter()
    while time.perf_counter() - begin < seconds or not errors:
        i = 37 * len(errors) % len(walks.starts)
        errors.append(compare(walks.starts[i], walks.modes[i], walks.actions[:, i]))
    largest = {name: max(error[name] for error in errors) for name in errors[0]}
    return {"steps": len(errors), "seconds": time.perf_counter() - begin, **largest}


def compare(start: Floats, mode: Any, actions: NDArray[np.float32]) -> dict[str, float]:
    """Largest errors of one piece of 2 s.

    Returns:
        `state_error`: of the states (rad, rad/s) at the ends of the control intervals, where kernel
        and reference have the same start and walk on their own. `event_error`: of the times of
        touchdowns (s), where the kernel starts from the reference's state at the beginning of the
        touchdown's control interval.

    Raises:
        RuntimeError: the two have different numbers of touchdowns.
    """
    from rimless_gym import preset, simulate
    from rimless_gym.energy import ROW
    from rimless_gym.equations import MODE_NAMES
    from rimless_gym.hybrid import CONTROL_PERIOD
    from rimless_gym.kernel.stepping import MODE, STATE_SIZE, advance

    params = preset(PRESET)

    volts = params.voltage_limit * actions.astype(np.float64)
    reference = simulate(params, start, volts, CONTROL_PERIOD * len(volts), mode=MODE_NAMES[mode])
    state = np.zeros((1, STATE_SIZE))
    state[0, :4], state[0, MODE] = start, mode
    located: list[float] = []
    error = 0.0
    for i, u in enumerate(volts):
        begin = CONTROL_PERIOD * i
        theirs = np.array([[*reference.state(begin), *state[0, 4:]]])
        row = advance(params, theirs, np.array([u]))[0]
        if row[ROW.touchdowns]:
            located.append(begin + row[ROW.touchdown_time])
        advance(params, state, np.array([u]))
        after = reference.state(begin + CONTROL_PERIOD)
        error = max(error, float(np.abs(state[0, :4] - after).max()))
    times = [event.time for event in reference.touchdowns]
    if len(times) != len(located):
        raise RuntimeError(f"{len(located)} touchdowns, {len(times)} by the reference")
    return {
        "state_error": error,
        "event_error": float(np.abs(np.subtract(located, times)).max(initial=0.0)),
    }


def load_walks(folder: Path) -> Walks:
    """The recorded walks, which are recorded if the folder has none."""
    path = folder / "walks.npz"
    if not path.exists():
        part = path.with_suffix(".part.npz")
        np.savez(part, **record_walks()._asdict())
        os.replace(part, path)
    with np.load(path, allow_pickle=False) as arrays:
        return Walks(**{name: arrays[name] for name in Walks._fields})


def record_walks(walks: int = WALKS, settling: int = SETTLING, recorded: int = RECORDED) -> Walks:
    """Let the LQR walk from the evaluation protocol's starts, and record the settled walks.

    Args:
        walks: how many.
        settling: control intervals that are not recorded, at the beginning.
        recorded: control intervals after that.

    """
    import gymnasium as gym

    from rimless_gym.equations import MODE_NAMES
    from trajopt import periodic_gait
    from trajopt.feedback import laws

    law = laws.design("lqr", periodic_gait(PRESET, speed=SPEED, steps=STEPS))
    envs: Any = gym.make_vec(
        "RimlessWheel-v0",
        num_envs=walks,
        params=PRESET,
        max_episode_steps=settling + recorded + 1,
        autoreset_mode=gym.vector.AutoresetMode.SAME_STEP,
    )
    envs.reset(seed=0)
    limit = envs.unwrapped.params[0].voltage_limit
    states, actions, lasting = [], [], np.full(walks, True)
    for i in range(settling + recorded):
        before = envs.unwrapped.states
        volts = law(before[:, :4], before[:, 4].astype(np.int64))
        action = np.clip(volts / limit, -1.0, 1.0).astype(np.float32)
        _, _, terminated, _, _ = envs.step(action[:, None])
        lasting &= ~terminated
        if i >= settling:
            states.append(before)
            actions.append(action)
    states.append(envs.unwrapped.states)
    edges = np.array(states[::WINDOW])[:, lasting]  # (windows + 1, walks, 6)
    played = np.array(actions)[:, lasting].reshape(-1, WINDOW, lasting.sum()).swapaxes(0, 1)
    first, end = edges[:-1].reshape(-1, edges.shape[2]), edges[1:].reshape(-1, edges.shape[2])
    recording = Walks(
        first[:, :4],
        first[:, 4].astype(np.int64),
        played.reshape(WINDOW, -1),
        end[:, :4],
    )
    single_env, accepted = gym.make("RimlessWheel-v0", params=PRESET), []
    for i, (start, mode) in enumerate(zip(recording.starts, recording.modes, strict=True)):
        try:
            single_env.reset(options={"state": start, "mode": MODE_NAMES[mode]})
            accepted.append(i)
        except ValueError:  # the foot would not press without a voltage
            continue
    return recording.pieces(np.array(accepted))


MEASURES = {
    "single": single,
    "vector": vector,
    "optimisation": optimisation,
    "fresh": fresh,
    "accuracy": accuracy,
}

if __name__ == "__main__":
    main()
