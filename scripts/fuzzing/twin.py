"""A single environment beside a row of a vector environment, which must be it to the last bit."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from rimless_gym.envs.layout import INFO_NAMES

NUMBERS = [name for name in INFO_NAMES if name != "failure"]


class Twin:
    """The single environment that row i is.

    Args:
        mode: of the vector environment's resets.
        settings: what it was made with, `num_envs` apart, and the machine `params` of this row.
        row: i.
        seed: of the vector environment.
        start: reset options of the row's first episode, after a first reset without; or None.

    Attributes:
        first: the first observation.
    """

    def __init__(
        self, mode: AutoresetMode, settings: dict[str, Any], row: int, seed: int, start: Any
    ) -> None:
        self.row = row
        self._mode = mode
        self._env = gym.make("RimlessWheel-v0", **settings)
        self.first, _ = self._env.reset(seed=seed + row)
        if start is not None:
            self.first, _ = self._env.reset(options=start)
        self._ended = False

    def trouble(self, action: Any, seen: Any) -> str | None:
        """Step along; what differs from the row's transition, if anything does.

        Args:
            action: of the row.
            seen: what the vector environment's `step` returned.
        """
        observations, rewards, terminated, truncated, info = seen
        i = self.row
        if self._ended:  # and the row is begun anew
            return self._begins_as(observations[i])
        observation, reward, *ends, one = self._env.step(action)
        ended = self._ended = any(ends)
        if [rewards[i], terminated[i], truncated[i]] != [reward, *ends]:
            return "reward or end is another alone"
        where = info
        if ended and self._mode is AutoresetMode.SAME_STEP:
            if not np.array_equal(info["final_obs"][i], observation):
                return "the last observation is another alone"
            where = info["final_info"]
            trouble = self._begins_as(observations[i])
            if trouble:
                return trouble
        elif not np.array_equal(observations[i], observation):
            return "the observation is another alone"
        for name in NUMBERS:
            if not _same(where[name][i], one[name]):
                return f"{name} is {where[name][i]!r} in the row, {one[name]!r} alone"
        return None

    def begin(self, observation: Any) -> str | None:
        """The row was reset by hand: reset likewise."""
        return self._begins_as(observation)

    def _begins_as(self, observation: Any) -> str | None:
        self._ended = False
        if not np.array_equal(self._env.reset()[0], observation):
            return "the first observation is another alone"
        return None


def _same(a: Any, b: Any) -> bool:
    return bool(a == b) or (a != a and b != b)
