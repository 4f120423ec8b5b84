"""Feedback laws for many speeds as one expert, which follows the speed that is commanded.

A law holds one gait. A ladder has one for every speed at which a step lasts a whole number of
control intervals; the law nearest to the command acts. A network that imitates it fills in the
speeds between them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.conditions import Conditions
from agents.policies import Policy, controller_policy
from rimless_gym.envs.observation import MIDDLE_SPEED, OBSERVATION_SIZE, SPEED_SCALE
from trajopt.feedback import laws
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.held.clock import held_speeds


@dataclasses.dataclass(frozen=True)
class Ladder:
    """A policy that acts as the one whose speed is nearest to the command.

    Attributes:
        speeds: of the rungs (m/s), (K,).
        rungs: a policy for each.

    Raises:
        ValueError: there is no rung, or not one policy for each speed.
    """

    speeds: Floats
    rungs: tuple[Policy, ...]

    def __post_init__(self) -> None:
        if not len(self.speeds) == len(self.rungs) > 0:
            raise ValueError(f"{len(self.speeds)} speeds for {len(self.rungs)} rungs: one for each")

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """Actions (N,) for states (N, STATE_SIZE) and observations (N, 8)."""
        commands = MIDDLE_SPEED + SPEED_SCALE * observations[:, OBSERVATION_SIZE].astype(np.float64)
        nearest = np.abs(commands[:, None] - self.speeds).argmin(axis=1)
        actions = np.empty(len(states))
        for k in np.unique(nearest):
            rows = nearest == k
            actions[rows] = self.rungs[k](states[rows], observations[rows])
        return actions


def ladder_of_laws(
    name: str, conditions: Conditions, steps: Sequence[int], progress: bool = False
) -> Ladder:
    """Feedback laws about the cheapest held gaits of all speeds that may be commanded.

    Args:
        name: of the law.
        conditions: machine and control, with commanded speeds.
        steps: numbers of steps per stride to consider.
        progress: whether to show progress bars.

    Raises:
        ValueError: there is no such law, or no speed is commanded.
        NoGaitError: there is no gait at any of the speeds.
    """
    if conditions.control.speeds is None:
        raise ValueError("conditions: no speed is commanded; give speeds")
    period, params = conditions.control.period, conditions.params
    speeds = held_speeds(params, *conditions.control.speeds, period)
    front = cot_front(params, speeds, steps, hold=period, progress=progress)
    gaits = tqdm(front.envelope, desc="laws", unit="law", disable=not progress, leave=False)
    rungs = tuple(controller_policy(params, laws.design(name, gait)) for gait in gaits)
    return Ladder(np.array([gait.speed for gait in front.envelope]), rungs)
