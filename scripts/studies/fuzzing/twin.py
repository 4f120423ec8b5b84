"""A single environment that a row of a vector environment must equal to the last bit."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from rimless_gym.envs.layout import INFO_NAMES

NUMBERS = [name for name in INFO_NAMES if name != "failure"]

_DIFFERS = "differs from the single environment's"
OTHER_START = f"the first observation {_DIFFERS}"


class Twin:
    """The single environment that does what one row of a vector environment does.

    Args:
        mode: when the vector environment's rows reset themselves.
        settings: arguments of `gym.make`: those of the vector environment, with the row's machine
            as `params`.
        row: number of the row.
        seed: of the vector environment.
        start: options of a second reset, if the row had one; or None.

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
        """Take the same step. Says what differs from the row's transition, or None.

        Args:
            action: of the row.
            seen: what the vector environment's `step` returned.
        """
        observations, rewards, terminated, truncated, info = seen
        i = self.row
        if self._ended:  # the vector environment has reset the row in this step
            return self._begins_as(observations[i])
        observation, reward, *ends, one = self._env.step(action)
        ended = self._ended = any(ends)
        if [rewards[i], terminated[i], truncated[i]] != [reward, *ends]:
            return f"the reward or an end {_DIFFERS}"
        where = info
        if ended and self._mode is AutoresetMode.SAME_STEP:
            if not np.array_equal(info["final_obs"][i], observation):
                return f"the last observation {_DIFFERS}"
            where = info["final_info"]
            trouble = self._begins_as(observations[i])
            if trouble:
                return trouble
        elif not np.array_equal(observations[i], observation):
            return f"the observation {_DIFFERS}"
        for name in NUMBERS:
            if not _same(where[name][i], one[name]):
                return f"{name} = {where[name][i]!r} in the row {_DIFFERS}: {one[name]!r}"
        return None

    def begin(self, observation: Any) -> str | None:
        """Reset as the row was reset by hand. Says what differs, or None."""
        return self._begins_as(observation)

    def _begins_as(self, observation: Any) -> str | None:
        self._ended = False
        if not np.array_equal(self._env.reset()[0], observation):
            return OTHER_START
        return None


def _same(a: Any, b: Any) -> bool:
    return bool(a == b) or (a != a and b != b)
