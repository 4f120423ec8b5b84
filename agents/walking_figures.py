"""How the noisy policy of a training walks: figures for its log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.learner import Log
from rimless_gym.energy import CHANNELS
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.params import WheelParams

_ENERGIES = tuple(channel.name for channel in CHANNELS)
_SUMMED = (*_ENERGIES, *TERM_NAMES, "distance", "steps", "elapsed")


class WalkingFigures:
    """Sums over control intervals, and the figures that follow from them.

    Args:
        params: the machine, by whose weight costs of transport are divided.

    Attributes:
        intervals: added since the figures were last recorded, all environments together.
    """

    def __init__(self, params: WheelParams) -> None:
        self._weight = params.weight
        self._clear()

    def _clear(self) -> None:
        self._sums = np.zeros(len(_SUMMED))
        self._falls = 0
        self.intervals = 0

    def add(self, info: Mapping[str, NDArray[Any]]) -> None:
        """Add an interval of N environments: the dense `info` of the vector environment."""
        self._sums += [info[name].sum() for name in _SUMMED]
        self._falls += int(np.count_nonzero(info["failure"]))
        self.intervals += len(info["failure"])

    def record(self, log: Log) -> None:
        """Record `walk/*`, and `energy/*` in watts, and start summing again.

        `walk/return` is the reward for 20 s, `walk/reward_*` its terms.
        """
        sums = dict(zip(_SUMMED, self._sums.tolist(), strict=True))
        rewards = sum(sums[name] for name in TERM_NAMES)
        log.record("walk/return", rewards / self.intervals * EPISODE_STEPS)
        for name in TERM_NAMES:
            log.record(f"walk/{name}", sums[name] / self.intervals * EPISODE_STEPS)
        log.record("walk/speed", sums["distance"] / sums["elapsed"])
        log.record("walk/steps_per_second", sums["steps"] / sums["elapsed"])
        log.record("walk/steps", sums["steps"])
        log.record("walk/falls", self._falls)
        if sums["distance"] > 0:
            energy = sums["electrical_positive"] + sums["idle"]
            log.record("walk/cot", energy / (self._weight * sums["distance"]))
        for name in _ENERGIES:
            log.record(f"energy/{name}", sums[name] / sums["elapsed"])
        self._clear()
