"""What walks, by name: a feedback law, a policy that comes with the package or in a file, or noise."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.policies import Policy, controller_policy, learned_policy
from agents.policy_files import PRETRAINED, load_policy
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.law import Floats

#: Walkers that are neither designed nor learned.
IDLE, RANDOM = "idle", "random"

#: Speed of the gait that laws hold (m/s): the one of the README's table.
SPEED = 0.56


@dataclasses.dataclass(frozen=True)
class Named:
    """A policy by its name.

    Attributes:
        name: without folder and ending, where it was read from a file.
        policy: that walks.
        conditions: machine and control, without disturbances.
        made: how it was made, in words.
    """

    name: str
    policy: Policy
    conditions: Conditions
    made: str


def known() -> str:
    """All names, for a help text."""
    return f"{IDLE}, {RANDOM}; laws: {', '.join(laws.names())}; policies: {', '.join(PRETRAINED)}"


def named(name: str, params: WheelParams | None = None, speed: float = SPEED) -> Named:
    """The walker of a name.

    Args:
        name: `IDLE`, `RANDOM`, a feedback law, a policy that comes with the package, or the path of
            a policy's file.
        params: the machine; None: a policy's own, and BUILDABLE for the others.
        speed: of the gait that laws hold (m/s), whose voltage is held for 10 ms.

    Raises:
        CheckpointError: there is no such file, or its policy is for another machine.
        NoGaitError: no gait for a law was found.
    """
    machine = params or BUILDABLE
    if name == IDLE:
        return Named(name, _idle, Conditions(machine), "no voltage at any time")
    if name == RANDOM:
        made = "uniformly random voltages, a new one in every step"
        return Named(name, _Random(), Conditions(machine), made)
    if name in laws.names():
        gait = periodic_gait(machine, speed, hold=CONTROL_PERIOD)
        policy = controller_policy(machine, laws.design(name, gait))
        made = f"feedback law about the optimal gait at {gait.speed:.3f} m/s (held for 10 ms)"
        return Named(name, policy, Conditions(machine), made)
    found = load_policy(name, params)
    of = Conditions(found.params, control=found.conditions.control)
    made = f"learned policy ({found.algo}), {found.record.get('timesteps', 0):,} steps of training"
    return Named(Path(name).stem, learned_policy(found.act), of, made)


def _idle(states: Floats, observations: NDArray[np.float32]) -> Floats:
    return np.zeros(len(states))


class _Random:
    """Uniform actions; every walker begins the same sequence."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        return self._rng.uniform(-1.0, 1.0, len(states))
