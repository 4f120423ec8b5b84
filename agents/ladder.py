"""Feedback laws for many speeds as one expert, which follows the speed that is commanded.

A law holds one gait. A ladder has one for every speed at which a step lasts a whole number of
control intervals. Near one of its gaits the law nearest to the command acts among those whose gaits
are in reach, so that a change of command climbs the ladder: a law that is far from its gait may
lose the foot, or slip. Elsewhere the law nearest to the command acts. A network that imitates the
ladder fills in the speeds between its rungs.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.conditions import Conditions
from agents.policies import Policy, controller_policy
from rimless_gym.envs.layout import MIDDLE_SPEED, OBSERVATION_SIZE, SPEED_SCALE
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import MODE
from trajopt.feedback import laws
from trajopt.feedback.controller import NEAR
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import Orbit, squared_distances
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.held_stride import held_speeds

#: Distance from its gait up to which a law is in reach on the way to another speed, in standard
#: deviations of the gait's own motion. It is well within `NEAR`, where laws act themselves and not
#: their start-up controllers. With 0.1, walks slip on the way from the gait of 0.52 m/s to that of
#: 0.62.
REACH = 0.06


@dataclasses.dataclass(frozen=True)
class Rung:
    """A policy that holds a gait.

    Attributes:
        speed: of the gait (m/s).
        policy: that holds it, and finds it from everywhere.
        orbit: of the gait.
    """

    speed: float
    policy: Policy
    orbit: Orbit


@dataclasses.dataclass(frozen=True)
class Ladder:
    """A policy that follows commanded speeds.

    Attributes:
        rungs: by rising speed.

    Raises:
        ValueError: there is no rung, or they do not rise.
    """

    rungs: tuple[Rung, ...]

    def __post_init__(self) -> None:
        speeds = [rung.speed for rung in self.rungs]
        if not speeds or any(low >= high for low, high in itertools.pairwise(speeds)):
            raise ValueError(f"rungs: have speeds {speeds}; give one or more, by rising speed")

    @property
    def speeds(self) -> Floats:
        """Speeds of the rungs (m/s), (K,)."""
        return np.array([rung.speed for rung in self.rungs])

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """Actions (N,) for states (N, STATE_SIZE) and observations (N, 8)."""
        commands = MIDDLE_SPEED + SPEED_SCALE * observations[:, OBSERVATION_SIZE].astype(np.float64)
        wanted = np.abs(commands[:, None] - self.speeds).argmin(axis=1)
        acting = self._towards(wanted, states)
        actions = np.empty(len(states))
        for k in np.unique(acting):
            rows = acting == k
            actions[rows] = self.rungs[k].policy(states[rows], observations[rows])
        return actions

    def _towards(self, wanted: NDArray[np.int64], states: Floats) -> NDArray[np.int64]:
        """The rungs (N,) that act: on the way to those that are wanted, (N,)."""
        smooth = np.ascontiguousarray(states[:, :4])
        away = np.stack([squared_distances(smooth, rung.orbit) for rung in self.rungs], axis=1)
        walking = (away.min(axis=1) <= NEAR**2) & (states[:, MODE] == SINGLE)
        left = np.abs(np.arange(len(self.rungs)) - wanted[:, None]).astype(np.float64)
        left[away > REACH**2] = np.inf
        towards = np.where(np.isfinite(left.min(axis=1)), left.argmin(axis=1), away.argmin(axis=1))
        return np.where(walking, towards, wanted)


def ladder_of_laws(
    name: str,
    conditions: Conditions,
    steps: Sequence[int],
    folder: Path | None = None,
    progress: bool = False,
) -> Ladder:
    """Feedback laws about the cheapest held gaits of all speeds that may be commanded.

    Args:
        name: of the law.
        conditions: machine and control, with commanded speeds.
        steps: numbers of steps per stride to consider.
        folder: where gaits and start-up controllers are stored for other ladders; None: nowhere.
        progress: whether to show progress bars.

    Raises:
        ValueError: there is no such law, or no speed is commanded.
        NoGaitError: there is no gait at any of the speeds.
    """
    if conditions.control.speeds is None:
        raise ValueError("conditions: no speed is commanded; give speeds")
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    period, params = conditions.control.period, conditions.params
    speeds = held_speeds(params, *conditions.control.speeds, period)
    front = cot_front(params, speeds, steps, hold=period, folder=folder, progress=progress)
    rungs = []
    for gait in tqdm(front.envelope, desc="laws", unit="law", disable=not progress, leave=False):
        law = laws.holding(name, gait)
        policy = controller_policy(params, laws.design(law, gait, folder))
        rungs.append(Rung(gait.speed, policy, law.data.orbit))
    return Ladder(tuple(rungs))
