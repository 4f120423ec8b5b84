"""How well a policy walks at the speeds that `RimlessWheelSpeed-v0` commands.

At each speed by itself, the policy is judged as every other one: from the same starts, for the
same time, by the same rules (`agents.evaluate`). The command stays as it is for the whole walk.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.evaluate import Evaluation, evaluate
from agents.policies import Policy
from agents.protocol import PROTOCOL, Protocol
from agents.verdicts import FALLS, STOPS
from rimless_gym.checks import real_array
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.task import Task
from rimless_gym.presets import BUILDABLE, Machine

#: The verdicts on walks whose foot slips, in stance or as it touches down.
SLIPS = ("slips", "slips_at_touchdown")

#: A slow command, a usual one, and one near the fastest that an episode may draw (m/s).
COMMANDS = (0.35, 0.5, 0.6)


@dataclasses.dataclass(frozen=True)
class Commanded:
    """How a policy walks at one commanded speed.

    Attributes:
        command: the speed that is commanded (m/s).
        evaluation: everything that was measured.
    """

    command: float
    evaluation: Evaluation

    @property
    def walking_share(self) -> float:
        """Of the starts: those that walk and keep the rules."""
        return self.evaluation.walking_share

    @property
    def stepping_share(self) -> float:
        """Of the starts: those that do not fall and still step at the end, slipping or not."""
        return 1.0 - self._share(FALLS) - self._share(STOPS)

    @property
    def slipping_share(self) -> float:
        """Of the starts: those that still take steps at the end, but whose foot slips."""
        return sum(map(self._share, SLIPS))

    @property
    def speed(self) -> float:
        """Of those that walk (m/s); NaN if none does."""
        return self.evaluation.speed

    @property
    def cot(self) -> float:
        """Cost of transport of those that walk, from E+; NaN if none does."""
        return self.evaluation.cot

    def _share(self, verdict: str) -> float:
        return self.evaluation.faults.get(verdict, 0) / len(self.evaluation.verdicts)


def evaluate_commanded(
    policy: Policy,
    commands: Sequence[float] = COMMANDS,
    params: Machine = BUILDABLE,
    protocol: Protocol = PROTOCOL,
    *,
    task: Task | Mapping[str, float] | None = None,
    ranges: Ranges | Mapping[str, Any] | None = None,
    disturbances: Disturbances | Mapping[str, Any] | None = None,
    control_period: float | None = None,
    progress: bool = False,
) -> tuple[Commanded, ...]:
    """Let a policy walk at each of some commanded speeds.

    Args:
        policy: see `agents.policies`; it is given observations (N, 8).
        commands: the speeds (m/s), one or more.
        params: the machine, as the environment takes it.
        protocol: starts and times.
        task: whose reward `objective` is, as the environment takes it.
        ranges: of parameters, as the environment takes them.
        disturbances: as the environment takes them.
        control_period: as the environment takes it.
        progress: whether to show a progress bar for each speed.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: no speed is given or one is out of its range, or as `evaluate` says.
        RuntimeError: as `evaluate` says.
    """
    speeds = real_array("commands", commands)
    if speeds.ndim != 1 or not len(speeds):
        raise ValueError(f"commands = {commands!r}: give one or more speeds (m/s)")
    judged = []
    for speed in speeds.astype(np.float64).tolist():
        walks = evaluate(
            policy,
            params,
            protocol,
            task=task,
            ranges=ranges,
            disturbances=disturbances,
            command=speed,
            control_period=control_period,
            progress=progress,
        )
        judged.append(Commanded(speed, walks))
    return tuple(judged)
