"""What walks are worth, and to which family of gaits they belong.

A family is the number of turns that the pendulum makes per step, forward or backward: 0 if it
swings or leans. No small change of a policy leads from one family to another, and a family in which
walking is easy to find is rarely the cheapest.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from agents.evolution.walks import Duration, Walks
from agents.pacing import FEWEST_STEPS, NO_WALK, CleanWalking
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: A walk belongs to a family if its turns per step differ by less than this.
WITHIN = 0.25

#: A wheel that lasted for at least this share of the time did not fall.
WHOLE = 1.0 - 1e-9


@dataclasses.dataclass(frozen=True)
class Worth:
    """What is paid for.

    Attributes:
        params: the machine.
        task: slipping and falling are charged as the task says.
        speed: up to which distance is paid (m/s).
    """

    params: WheelParams
    task: Task
    speed: float

    def of(
        self, walks: Walks, duration: Duration, family: float, price: float, judged: float = 1.0
    ) -> Floats:
        """The mean earnings (P,) of policies per second (m/s), at a price of distance.

        The earnings are those of the window, as a cost of transport is that of a steady walk: the
        energy to get there is several times that of the gait, and would hide it. A fall costs up
        to twice what the task says, the more the earlier it is. Distance in another family's gait
        is not paid. Only each policy's best starts count, as many of them as `judged` says (a
        share, at least one start).
        """
        time = duration.window * CONTROL_PERIOD
        energy = walks.energy / self.params.weight + self._idle(duration)
        off = np.abs(turns(walks) - family)
        own = np.where(walks.steps >= FEWEST_STEPS, np.clip(1.5 - 2.0 * off, 0.0, 1.0), 1.0)
        paid = np.minimum(walks.distance, self.speed * time)
        paid = np.where(paid > 0.0, own * paid, paid)
        slipped = self.task.slip_penalty * CONTROL_PERIOD * walks.slipping
        fallen = self.task.fall_penalty * (walks.lasted < WHOLE) * (2.0 - walks.lasted)
        earned = price * (paid - slipped - fallen) - energy
        count = max(1, round(judged * earned.shape[1]))
        return np.asarray(np.sort(earned, axis=1)[:, -count:].mean(axis=1) / time)

    def _idle(self, duration: Duration) -> float:
        """Idle energy in the window, over the weight (m)."""
        return self.params.idle_power * duration.window * CONTROL_PERIOD / self.params.weight

    def costs(self, walks: Walks, duration: Duration) -> Floats:
        """Costs of transport (P, S) in the window; infinite where there is no way forward."""
        distance = walks.distance
        energy = walks.energy / self.params.weight + self._idle(duration)
        costs = energy / np.maximum(distance, 1e-12)
        return np.asarray(np.where(distance > 0.0, costs, np.inf))

    def gait(self, walks: Walks, duration: Duration, family: float) -> CleanWalking:
        """How the first policy of some walks walks in its family's gait."""
        fits = members(walks, family)[0] & (walks.slipping[0] == 0.0)
        if not fits.any():
            return NO_WALK
        time = duration.window * CONTROL_PERIOD * fits.sum()
        distance = walks.distance[0][fits].sum()
        energy = walks.energy[0][fits].sum() + self.params.idle_power * time
        return CleanWalking(
            float(fits.mean()),
            float(energy / (self.params.weight * distance)) if distance > 0.0 else np.inf,
            float(distance / time),
        )


def stepping(walks: Walks) -> NDArray[np.bool_]:
    """Whether the wheels still take steps forward at the end, (P, S)."""
    return (walks.lasted > WHOLE) & (walks.steps >= FEWEST_STEPS)


def members(walks: Walks, family: float) -> NDArray[np.bool_]:
    """Which wheels walk in a family's gait, (P, S)."""
    return stepping(walks) & (np.abs(turns(walks) - family) < WITHIN)


def turns(walks: Walks) -> Floats:
    """Turns of the pendulum per step in the window, (P, S)."""
    return np.asarray(walks.turned / (2.0 * np.pi) / np.maximum(walks.steps, 1.0))


def senses(walks: Walks) -> NDArray[np.int64]:
    """In which sense pendulums go round in the window of wheels that do not fall, (P, S).

    -1 forward, 1 backward, 0 for those that turn less than half a turn.
    """
    goes_round = (np.abs(walks.turned) > np.pi) & (walks.lasted > WHOLE)
    return np.asarray(np.where(goes_round, np.sign(walks.turned), 0.0), dtype=np.int64)


def families(walks: Walks) -> NDArray[np.int64]:
    """The families in which some wheel walks, fewest turns first."""
    found = np.unique(np.round(turns(walks))[stepping(walks)])
    kept = [family for family in found.tolist() if members(walks, family).any()]
    return np.asarray(sorted(kept, key=lambda family: (abs(family), family)), dtype=np.int64)
