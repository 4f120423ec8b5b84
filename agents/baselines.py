"""Walkers that are neither designed nor learned: what every other walker has to beat."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.policies import Policy
from agents.walkers import Walker, walker
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution


def idle(states: Floats, observations: NDArray[np.float32]) -> Floats:
    """No voltage."""
    return np.zeros(len(states))


def uniform(seed: int) -> Policy:
    """Uniformly random voltages; every policy of one seed gives the same sequence."""
    rng = np.random.default_rng(seed)
    return lambda states, observations: rng.uniform(-1.0, 1.0, len(states))


#: How each is begun, by name; from a seed.
BASELINES: dict[str, Callable[[int], Policy]] = {"idle": lambda seed: idle, "random": uniform}


def walker_or_baseline(
    name: str,
    gait_for: Callable[[WheelParams], Solution],
    params: WheelParams | None = None,
    seed: int = 0,
) -> Walker:
    """One of `BASELINES`, which follow the seed, or what `agents.walkers.walker` finds.

    Raises:
        ValueError, CheckpointError, NoGaitError: see there.
    """
    if name in BASELINES:
        return Walker(name, BASELINES[name](seed), Conditions(params or BUILDABLE))
    return walker(name, gait_for, params)
