"""Random starts of a case: waypoints, in durations that are spread over orders of magnitude."""

from __future__ import annotations

import dataclasses

import numpy as np

from trajopt.ocp.constraints import pair
from trajopt.ocp.guesses import Guess, Waypoints
from trajopt.ocp.trajectory import PhaseTrajectory


@dataclasses.dataclass(frozen=True)
class WaypointStarts(Waypoints):
    """Random waypoints; the logarithms of the durations are uniformly distributed.

    Attributes:
        durations: least and most (s).
    """

    durations: tuple[float, float] = (0.2, 4.0)

    def __call__(self, rng: np.random.Generator, index: int) -> Guess:
        """Guess number `index`."""
        low, high = np.log(self.durations)
        pairs = zip(self.problem.phases, super().__call__(rng, index), strict=True)
        return tuple(
            _stretched(trajectory, np.clip(np.exp(rng.uniform(low, high)), *pair(phase.duration)))
            for phase, trajectory in pairs
        )


def _stretched(trajectory: PhaseTrajectory, duration: float) -> PhaseTrajectory:
    return dataclasses.replace(
        trajectory, edges=trajectory.edges * (duration / trajectory.duration)
    )
