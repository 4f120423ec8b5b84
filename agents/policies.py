"""What a policy is here, and how learned policies and feedback laws become one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rimless_gym.envs.layout import OBSERVATION_SIZE, observe
from rimless_gym.kernel.stepping import MODE
from rimless_gym.presets import Machine, as_params
from trajopt.feedback.law import Controller, Floats, require_machine

#: Titles of feedback laws that are not simply their names with spaces.
LAW_TITLES = {"input_output": "input-output", "lqr": "LQR", "pid": "PD"}

#: (states (N, 6), observations (N, 6 or 8)) -> actions (N,): voltages in units of the limit, in
#: [-1, 1]. Observations are what a learner may use. States are for feedback laws.
Policy: TypeAlias = Callable[[Floats, NDArray[np.float32]], Floats]

#: observations (N, 6 or 8) -> actions (N,) in [-1, 1]: the deterministic policy of a learner.
Act: TypeAlias = Callable[[NDArray[np.float32]], Floats]


@dataclasses.dataclass(frozen=True)
class Seeing:
    """A learner's policy that refuses observations of another shape than it was trained on.

    Attributes:
        act: the policy.
        size: numbers of an observation, 6 or 8.
    """

    act: Act
    size: int

    def __call__(self, observations: NDArray[np.float32]) -> Floats:
        """The actions, (N,).

        Raises:
            ValueError: the observations are not (N, size).
        """
        shape = np.shape(observations)
        if len(shape) != 2 or shape[1] != self.size:
            raise ValueError(f"observations: must have shape (N, {self.size}), not {shape}")
        return self.act(observations)


def learned_policy(act: Act) -> Policy:
    """A learner's policy, which sees the observations only."""

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        return act(observations)

    return policy


def controller_policy(params: Machine, controller: Controller) -> Policy:
    """A feedback law in volts as a policy, clipped to the limit of a machine.

    Args:
        params: the machine, as the environment takes it.
        controller: the law.

    Raises:
        TypeError, ValueError: there is no such machine, or the law was made for another one.
    """
    machine = as_params(params)
    require_machine("controller", controller, machine)

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        volts = controller(states[:, :4], states[:, MODE].astype(np.int64))
        return np.clip(np.asarray(volts, dtype=np.float64) / machine.voltage_limit, -1.0, 1.0)

    return policy


def seeing_policy(params: Machine, act: Act) -> Policy:
    """A learner's policy that sees the true state where sensors are noisy, to be imitated."""
    machine = as_params(params)

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        seen = observations.copy()
        seen[:, :OBSERVATION_SIZE] = observe(machine, states)
        return act(seen)

    return policy


def law_title(law: str) -> str:
    """The title of a law, one of `trajopt.feedback.laws.names()`, in tables and plots."""
    return LAW_TITLES.get(law, law.replace("_", " "))
