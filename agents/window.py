"""What walks amount to over the measured window: energies, distances, extremes and rewards."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.rollout import Interval
from rimless_gym.energy import Ledger
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: The fields of a ledger, which are summed, and what `info` calls them where it differs.
_LEDGER = tuple(field.name for field in dataclasses.fields(Ledger))
_INFO_NAMES = {"time": "elapsed"}

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
        sums: of the fields of a ledger, (N, fields).
        extremes: (N,) each.
    """

    def __init__(self, machines: Sequence[WheelParams]) -> None:
        n = len(machines)
        self.machines = machines
        self.sums = np.zeros((n, len(_LEDGER)))
        self.extremes = {
            name: np.zeros(n) if worse is np.maximum else np.full(n, np.inf)
            for name, worse in _EXTREMES.items()
        }

    def add(self, interval: Interval) -> None:
        """Add a control interval."""
        i, info = interval.running, interval.info
        self.sums[i] += np.stack([info[_INFO_NAMES.get(name, name)] for name in _LEDGER], axis=1)
        for name, worse in _EXTREMES.items():
            self.extremes[name][i] = worse(self.extremes[name][i], info[name])

    def ledgers(self) -> list[Ledger]:
        """The ledger of each walk."""
        return [Ledger(*row) for row in self.sums.tolist()]

    def total(self, some: NDArray[np.bool_], params: WheelParams) -> tuple[Ledger, Ledger]:
        """The ledger of some walks together; and with distances in proportion to their weights."""
        weights = np.array([machine.weight for machine in self.machines]) / params.weight
        distances = weights * self.sums[:, _LEDGER.index("distance")]
        *sums, carried = np.column_stack([self.sums, distances])[some].sum(axis=0).tolist()
        ledger = Ledger(*sums)
        return ledger, dataclasses.replace(ledger, distance=carried)

    def rewards(self, task: Task, fallen: NDArray[np.bool_]) -> Floats:
        """The reward (m) of each walk; one that fell pays for that once, whenever it was."""
        return np.array(
            [
                sum(task.reward_terms(machine, ledger.distance, ledger.energy, fell))
                for machine, ledger, fell in zip(self.machines, self.ledgers(), fallen, strict=True)
            ]
        )

    def extreme(self, name: str, some: NDArray[np.bool_]) -> float:
        """The worst value of some walks; NaN if there are none."""
        values = self.extremes[name][some]
        return float(_EXTREMES[name].reduce(values)) if len(values) else math.nan
