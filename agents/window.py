"""What walks amount to over the measured window: energies, distances, extremes and rewards."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.rollout import Interval
from rimless_gym.energy import CHANNELS, Ledger
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.params import WheelParams
from rimless_gym.rules import Extremes
from trajopt.feedback.law import Floats

#: The entries of `info` that are summed.
_SUMMED = ("elapsed", "distance", *(channel.name for channel in CHANNELS), *TERM_NAMES)

#: Extremes of an interval, with the function that finds them over many intervals.
_EXTREMES = {
    "friction_demand": np.maximum,
    "impulse_friction_demand": np.maximum,
    "min_normal_force": np.minimum,
    "clearance": np.minimum,
}


class Window:
    """Sums and extremes of each walk over the measured window.

    Attributes:
        machines: of the walks, N of them.
        sums: of entries of `info`, (N,) each.
        extremes: of entries of `info`, (N,) each.
    """

    def __init__(self, machines: Sequence[WheelParams]) -> None:
        n = len(machines)
        self.machines = machines
        self.sums = {name: np.zeros(n) for name in _SUMMED}
        self.extremes = {
            name: np.zeros(n) if worse is np.maximum else np.full(n, np.inf)
            for name, worse in _EXTREMES.items()
        }

    def add(self, interval: Interval) -> None:
        """Add a control interval."""
        i, info = interval.running, interval.info
        for name in _SUMMED:
            self.sums[name][i] += info[name]
        for name, worse in _EXTREMES.items():
            self.extremes[name][i] = worse(self.extremes[name][i], info[name])

    def ledgers(self) -> list[Ledger]:
        """The ledger of each walk."""
        columns = zip(*(values.tolist() for values in self.sums.values()), strict=True)
        return [Ledger.of(dict(zip(_SUMMED, sums, strict=True))) for sums in columns]

    def total(self, some: NDArray[np.bool_], params: WheelParams) -> tuple[Ledger, Ledger]:
        """The summed ledger of some walks, twice.

        In the second one, each distance is multiplied by the weight of its machine over that of
        `params`.
        """
        weights = np.array([machine.weight for machine in self.machines]) / params.weight
        ledger = Ledger.of({name: float(sums[some].sum()) for name, sums in self.sums.items()})
        carried = float((weights * self.sums["distance"])[some].sum())
        return ledger, dataclasses.replace(ledger, distance=carried)

    def rewards(self, charges: Floats) -> Floats:
        """The reward (m) of each walk (N,).

        Args:
            charges: what each walk paid for its end, whenever that was (m), (N,).
        """
        running = sum(self.sums[name] for name in TERM_NAMES if name != "reward_end")
        return np.asarray(running + charges)

    def extremes_of(self, walk: int) -> Extremes:
        """The extremes of one walk."""
        return Extremes(**{name: float(values[walk]) for name, values in self.extremes.items()})

    def extreme(self, name: str, some: NDArray[np.bool_], unit: Floats | float = 1.0) -> float:
        """The worst value of some walks, in a unit for all or for each; NaN if there are none."""
        values = (self.extremes[name] / unit)[some]
        return float(_EXTREMES[name].reduce(values)) if len(values) else math.nan
