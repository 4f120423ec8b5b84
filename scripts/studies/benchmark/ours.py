"""Speed of this package: `python -m scripts.studies.benchmark.ours SETTINGS`.

But for `played` and `learned`, environments replay recorded walks: states on an optimal gait, and
the actions with which an LQR holds it. That times the simulator without the LQR, on the motion that
matters. Without feedback a gait is unstable, so walks are short: after 2 s, simulators that agree
to rounding error still walk alike.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scripts.studies.benchmark import swing_up

Floats = NDArray[np.float64]

#: The machine and the gait that is walked.
PRESET, SPEED, STEPS = "BUILDABLE", 0.5, 1

#: How many walks are recorded, from as many phases of the gait.
WALKS = 128

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
    """Walks of `WINDOW` control intervals, from states in single stance."""

    starts: Floats  # phi, theta, phi', theta', (M, 4)
    actions: NDArray[np.float32]  # as the environment takes them, (WINDOW, M) float32
    ends: Floats  # states (M, 4) after the last interval

    def checked(self, difference: Any) -> float:
        """The largest difference of a replay from the recorded end, if it is within `TOLERANCE`."""
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

    walks, numbers = load_walks(Path(folder)), count()
    env: Any = gym.make("rimless_gym:RimlessWheel-v0", params=PRESET)

    def replay() -> tuple[int, float, float]:
        i = next(numbers) % len(walks.starts)
        env.reset(options={"state": walks.starts[i]})
        elapsed = stepped(env, walks.actions[:, i : i + 1])
        return WINDOW, elapsed, walks.checked(env.unwrapped.state[:4] - walks.ends[i])

    return replayed(replay, seconds)


def vector(seconds: float, folder: str, n: int) -> dict[str, Any]:
    """The native vector environment, with observations, rewards and infos. Resets are not timed."""
    import gymnasium as gym

    walks = load_walks(Path(folder))
    index = np.arange(n) % len(walks.starts)
    walks = Walks(walks.starts[index], walks.actions[:, index], walks.ends[index])
    envs: Any = gym.make_vec("rimless_gym:RimlessWheel-v0", num_envs=n, params=PRESET)

    def replay() -> tuple[int, float, float]:
        envs.reset(options={"state": walks.starts})
        elapsed = stepped(envs, walks.actions[:, :, None])
        return n * WINDOW, elapsed, walks.checked(envs.unwrapped.states[:, :4] - walks.ends)

    return replayed(replay, seconds)


def played(seconds: float, folder: str, n: int) -> dict[str, Any]:
    """The vector environment under random actions, after a while of them: most wheels stand."""
    import gymnasium as gym

    envs: Any = gym.make_vec("rimless_gym:RimlessWheel-v0", num_envs=n, params=PRESET)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (WINDOW, n, 1)).astype(np.float32)
    envs.reset(seed=0)
    stepped(envs, actions)
    begin = envs.unwrapped.get_state()

    def replay() -> tuple[int, float, float]:
        envs.unwrapped.set_state(begin)
        return n * WINDOW, stepped(envs, actions), 0.0

    return replayed(replay, seconds)


def learned(seconds: float, folder: str, n: int) -> dict[str, Any]:
    """PPO of stable-baselines3 on the vector environment: its own networks, roll-outs of 64."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    from agents import Sb3VecEnv

    torch.set_num_threads(1)
    kind: Any = Sb3VecEnv
    envs = make_vec_env("RimlessWheel-v0", n_envs=n, vec_env_cls=kind)
    model = PPO("MlpPolicy", envs, n_steps=64, batch_size=4096, n_epochs=3, device="cpu")

    def replay() -> tuple[int, float, float]:
        begin = time.perf_counter()
        model.learn(64 * n, reset_num_timesteps=False)
        return 64 * n, time.perf_counter() - begin, 0.0

    return replayed(replay, seconds)


def stepped(env: Any, actions: NDArray[np.float32]) -> float:
    """The seconds that an environment takes for some actions, one after the other."""
    given = list(actions)
    begin = time.perf_counter()
    for action in given:
        env.step(action)
    return time.perf_counter() - begin


def replayed(replay: Callable[[], tuple[int, float, float]], seconds: float) -> dict[str, Any]:
    """Repeat a replay, which returns its steps, seconds and error, after a while of warming up."""
    error = 0.0
    for duration in (0.3, seconds):
        steps, elapsed = 0, 0.0
        while elapsed < duration:
            more, spent, apart = replay()
            steps, elapsed, error = steps + more, elapsed + spent, max(error, apart)
    return {"steps": steps, "seconds": elapsed, "replay_error": error}


def optimisation(seconds: float, folder: str) -> dict[str, Any]:
    """Kelly's cart-pole: the problem is built, and solved on one mesh."""
    from scripts.studies.textbook import cart_pole
    from trajopt.ocp.guesses import straight_lines
    from trajopt.ocp.mesh import Mesh
    from trajopt.ocp.transcription import Transcription

    def build() -> Transcription:
        problem = cart_pole()
        mesh = Mesh.uniform(problem, elements=swing_up.SEGMENTS, scheme="hermite-simpson")
        transcription = Transcription(problem, mesh)
        transcription.solver()
        return transcription

    def solve(transcription: Transcription) -> tuple[float, float]:
        result = transcription.solve(straight_lines(transcription.problem))
        return result.iterations, result.cost

    return swing_up.repeated(swing_up.Tool("rimless-gym", build, solve), seconds)


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


def load_walks(folder: Path) -> Walks:
    """The recorded walks, which are recorded if the folder has none."""
    path = folder / f"walks_{WALKS}.npz"
    if not path.exists():
        np.savez(path, **recorded_walks()._asdict())
    with np.load(path, allow_pickle=False) as arrays:
        return Walks(**{name: arrays[name] for name in Walks._fields})


def recorded_walks() -> Walks:
    """Walks on the gait, begun at phases all over its stride and held by the LQR."""
    from rimless_gym.equations import SINGLE
    from rimless_gym.kernel.stepping import advance, hybrid_states
    from trajopt import periodic_gait
    from trajopt.feedback import laws

    gait = periodic_gait(PRESET, speed=SPEED, steps=STEPS)
    law, limit = laws.holding("lqr", gait), gait.params.voltage_limit
    starts = gait.state(gait.duration * (np.arange(WALKS) + 0.5) / WALKS)
    states, actions = hybrid_states(starts, SINGLE), []
    for _ in range(WINDOW):
        volts = law(states[:, :4], states[:, 4].astype(np.int64))
        actions.append(np.clip(volts / limit, -1.0, 1.0).astype(np.float32))
        advance(gait.params, states, limit * actions[-1].astype(np.float64))
    return Walks(starts, np.array(actions), states[:, :4])


MEASURES = {
    "single": single,
    "vector": vector,
    "played": played,
    "learned": learned,
    "optimisation": optimisation,
    "fresh": fresh,
}

if __name__ == "__main__":
    main()
