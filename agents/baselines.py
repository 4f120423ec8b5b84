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


def uniform() -> Policy:
    """Uniformly random voltages; every policy that this returns gives the same sequence."""
    rng = np.random.default_rng(0)
    return lambda states, observations: rng.uniform(-1.0, 1.0, len(states))


#: How each is begun, by name.
BASELINES: dict[str, Callable[[], Policy]] = {"idle": lambda: idle, "random": uniform}


def walker_or_baseline(
    name: str, gait_for: Callable[[WheelParams], Solution], params: WheelParams | None = None
) -> Walker:
    """One of `BASELINES`, or what `agents.walkers.walker` finds; it says what is raised."""
    if name in BASELINES:
        return Walker(name, BASELINES[name](), Conditions(params or BUILDABLE))
    return walker(name, gait_for, params)
