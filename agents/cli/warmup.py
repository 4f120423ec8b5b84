"""Compile the simulator now, so that nobody waits for it later. The compiled code is kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import gymnasium
import numpy as np

from agents.cli.commandline import Parser
from agents.evaluate import evaluate
from agents.protocol import Protocol
from rimless_gym import BUILDABLE, simulate


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    Parser(__doc__).parse_args(arguments)
    for name, compiled in PARTS.items():
        begun = time.perf_counter()
        compiled()
        print(f"{name}: {time.perf_counter() - begun:.1f} s")
    return 0


def environment() -> None:
    """One wheel."""
    env = gymnasium.make("RimlessWheel-v0")
    env.reset(seed=0)
    env.step(np.zeros(1, np.float32))


def vector_environment() -> None:
    """Many wheels."""
    envs = gymnasium.make_vec("RimlessWheel-v0", num_envs=16)
    envs.reset(seed=0)
    envs.step(np.zeros((16, 1), np.float32))


def roll_outs() -> None:
    """Walks of a policy."""
    brief = Protocol(starts=2, duration=0.2, window=0.1, alive=0.1)
    evaluate(lambda states, observations: np.zeros(len(states)), protocol=brief)


def reference_simulator() -> None:
    """The adaptive integrator."""
    simulate(BUILDABLE, [1.5, 0.0, 2.0, 0.0], lambda t, x: 4.0, duration=0.1)


PARTS: dict[str, Callable[[], None]] = {
    "environment": environment,
    "vector environment": vector_environment,
    "roll-outs": roll_outs,
    "reference simulator": reference_simulator,
}
