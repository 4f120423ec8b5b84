"""The best of the policies that a training passes through.

From update to update a policy walks from a few more or a few less starts, and a little cheaper or
dearer. So the last one is seldom the best.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from agents.pacing import CleanWalking
from agents.sb3.products import policy_of
from agents.scores import economy
from trajopt.feedback.law import Floats


class KeepBest(BaseCallback):
    """Looks at the policy now and then, between two roll-outs, and keeps the weights of the best.

    It logs `looks/share` and `looks/cot`.

    Args:
        gait_of: how the policy with some weights walks.
        every: time steps between two looks.

    Attributes:
        weights: of the policy with the greatest `economy` so far; None before any has walked.
    """

    def __init__(self, gait_of: Callable[[Floats], CleanWalking], every: int) -> None:
        super().__init__()
        self.weights: Floats | None = None
        self._gait_of, self._every = gait_of, every
        self._economy, self._due = 0.0, 0

    def _on_rollout_start(self) -> None:
        if self.num_timesteps < self._due:
            return
        self._due = self.num_timesteps + self._every
        weights = policy_of(self.model.policy)
        gait = self._gait_of(weights)
        self.logger.record("looks/share", gait.share)
        if np.isfinite(gait.cot):
            self.logger.record("looks/cot", gait.cot)
        found = economy(gait.share, gait.cot)
        if found > self._economy:
            self._economy, self.weights = found, weights

    def _on_step(self) -> bool:
        return True

    def state(self) -> dict[str, Any]:
        """What it has kept, and when it looks next."""
        weights = np.zeros(0) if self.weights is None else self.weights
        return {"weights": weights, "economy": self._economy, "due": self._due}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self.weights = state["weights"] if len(state["weights"]) else None
        self._economy, self._due = float(state["economy"]), int(state["due"])
