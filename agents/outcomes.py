"""What walks amount to over the measured window: sums, extremes, periods, which of them count."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.rollout import Interval
from rimless_gym.energy import CHANNELS, Ledger
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.kernel.stepping import FOOT
from rimless_gym.params import WheelParams
from rimless_gym.rules import VIOLATIONS, Extremes, violations
from trajopt.feedback.law import Floats

#: Outcomes of a start: it walks; it falls; it takes no steps at the end; or its walk violates a
#: rule, of which the first in the order of `rimless_gym.rules.VIOLATIONS` is named.
WALKS, FALLS, STOPS = "walks", "falls", "stops"
OUTCOMES = (WALKS, FALLS, STOPS, *VIOLATIONS)

#: Longest period that is detected (steps).
MAX_PERIOD = 6

#: Durations of steps that differ by less (relative) count as the same. Touchdowns fall anywhere
#: within a hold of 10 ms, so even a perfect gait scatters.
TOLERANCE = 0.02

#: The entries of `info` that are summed.
_SUMMED = ("elapsed", "distance", *(channel.name for channel in CHANNELS), *TERM_NAMES)

#: Extremes of an interval, with the function that finds them over many intervals.
_EXTREMES = {
    "friction_demand": np.maximum,
    "impulse_friction_demand": np.maximum,
    "min_normal_force": np.minimum,
    "clearance": np.minimum,
}


def outcomes(
    fallen: NDArray[np.bool_], stepping: NDArray[np.bool_], window: WindowTotals
) -> tuple[str, ...]:
    """The outcome of each start, one of `OUTCOMES`; `stepping` is at the end, (N,)."""
    results = []
    for i, params in enumerate(window.machines):
        if fallen[i]:
            results.append(FALLS)
        elif not stepping[i]:
            results.append(STOPS)
        else:
            results.append((*violations(params, window.extremes_of(i)), WALKS)[0])
    return tuple(results)


def count_failures(results: Sequence[str]) -> dict[str, int]:
    """How many starts do not count, by outcome; only those that occur."""
    counts = Counter(results)
    return {each: counts[each] for each in OUTCOMES if each != WALKS and each in counts}


class WindowTotals:
    """Sums and extremes of each walk over the measured window.

    Energies, distance and time count from the first to the last touchdown of a forward step in the
    window, so that only whole steps do; they change evenly over the two intervals that these
    touchdowns split. Rewards and extremes are those of the whole window, and so is everything of a
    walk with fewer than two such touchdowns.

    Attributes:
        machines: of the walks, N of them.
        extremes: of entries of `info`, (N,) each.
    """

    def __init__(self, machines: Sequence[WheelParams]) -> None:
        n = len(machines)
        self.machines = machines
        self._sums = np.zeros((len(_SUMMED), n))
        self._to_first, self._to_last = np.full_like(self._sums, np.nan), self._sums.copy()
        self.extremes = {
            name: np.zeros(n) if worse is np.maximum else np.full(n, np.inf)
            for name, worse in _EXTREMES.items()
        }

    def add(self, interval: Interval) -> None:
        """Add a control interval."""
        i, info = interval.running, interval.info
        values = np.stack([info[name] for name in _SUMMED])
        self._sums[:, i] += values
        k = np.flatnonzero(info["steps"] > 0)
        after = 1.0 - info["touchdown_time"][k] / info["elapsed"][k]
        self._to_last[:, i[k]] = self._sums[:, i[k]] - after * values[:, k]
        first = i[k][np.isnan(self._to_first[0, i[k]])]
        self._to_first[:, first] = self._to_last[:, first]
        for name, worse in _EXTREMES.items():
            self.extremes[name][i] = worse(self.extremes[name][i], info[name])

    def ledgers(self) -> list[Ledger]:
        """The ledger of each walk."""
        return [_ledger(sums) for sums in self._whole_steps().T]

    def total(self, some: NDArray[np.bool_], params: WheelParams) -> tuple[Ledger, Ledger]:
        """The summed ledger of some walks, twice.

        In the second one, each distance is multiplied by the weight of its machine over that of
        `params`.
        """
        weights = np.array([machine.weight for machine in self.machines]) / params.weight
        sums = self._whole_steps()[:, some]
        ledger = _ledger(sums.sum(axis=1))
        carried = float((weights[some] * sums[_SUMMED.index("distance")]).sum())
        return ledger, dataclasses.replace(ledger, distance=carried)

    def _whole_steps(self) -> Floats:
        """The sums from the first to the last touchdown, (entries, N)."""
        between = self._to_last - self._to_first
        return np.where(between[_SUMMED.index("elapsed")] > 0.0, between, self._sums)

    def rewards(self, penalties: Floats) -> Floats:
        """The reward (m) of each walk (N,), with its penalty (N,) for its end at any time."""
        running = [name in TERM_NAMES and name != "reward_end" for name in _SUMMED]
        return np.asarray(self._sums[running].sum(axis=0) + penalties)

    def extremes_of(self, walk: int) -> Extremes:
        """The extremes of one walk."""
        return Extremes(**{name: float(values[walk]) for name, values in self.extremes.items()})

    def extreme(self, name: str, some: NDArray[np.bool_], unit: Floats | float = 1.0) -> float:
        """The worst value of some walks, in a unit for all or for each; NaN if there are none."""
        values = (self.extremes[name] / unit)[some]
        return float(_EXTREMES[name].reduce(values)) if len(values) else math.nan


def _ledger(sums: Floats) -> Ledger:
    return Ledger.of(dict(zip(_SUMMED, sums.tolist(), strict=True)))


class TouchdownLog:
    """Times of the touchdowns on a new foot (s), of N walks side by side."""

    def __init__(self, n: int) -> None:
        self.times: list[list[float]] = [[] for _ in range(n)]
        self._furthest = np.full(n, -np.inf)

    def add(self, interval: Interval, begins: float) -> None:
        """Add the touchdowns of a control interval that begins at a time (s)."""
        foot = interval.after[:, FOOT]
        stepped = (foot > self._furthest[interval.running]) & (interval.info["steps"] > 0)
        for k in np.flatnonzero(stepped):
            i = interval.running[k]
            self._furthest[i] = foot[k]
            self.times[i].append(begins + float(interval.info["touchdown_time"][k]))


def steps_per_period(times: Sequence[float]) -> int:
    """Steps after which the durations of steps repeat, from touchdown times; 0: none up to 6."""
    durations = np.diff(times)
    for k in range(1, MAX_PERIOD + 1):
        if len(durations) < 3 * k:
            return 0
        change = durations[k:] - durations[:-k]
        if np.sqrt(np.mean(change**2)) < TOLERANCE * durations.mean():
            return k
    return 0
