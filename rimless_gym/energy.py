"""Energy accounting: the ledger of an interval, and cost of transport. One definition everywhere.

Over any interval, whatever the motion, the energies of `CHANNELS` balance:

    electrical + push = (losses) + collision + mechanical_change

with the losses of `rimless_gym.equations.LOSSES`. The mechanical energy includes the descent of
the stance foot. `Ledger.residual` is what is left over.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.equations import LOSSES, Losses, places, record
from rimless_gym.params import WheelParams


class Channel(NamedTuple):
    """An energy of the ledger (J)."""

    name: str  # shared by the kernel's row, the entry in `info` and the ledger's field
    sign: int  # 1 for energy that comes in, -1 for where it goes, 0 if it is outside the balance
    meaning: str  # one line of documentation


#: The energies that the simulators account for in every interval.
ACCOUNTED = (
    Channel("electrical", 1, "integral of V i; the battery can be recharged"),
    Channel("electrical_positive", 0, "integral of max(V i, 0); the battery cannot be recharged"),
    *(Channel(name, -1, meaning) for name, meaning in LOSSES.items()),
    Channel("collision", -1, "loss in touchdowns (signed under the non-physical impact laws)"),
    Channel("shaft", 0, "integral of |T psi'|, the thesis's measure"),
    Channel("mechanical_change", -1, "change of kinetic and potential energy, descent included"),
)

#: All channels, including those that the environment adds.
CHANNELS = (
    *ACCOUNTED,
    Channel("idle", 0, "idle power times duration"),
    Channel("push", 1, "work of pushes on the hub"),
)

#: The stepping kernel's rows that are sums over an interval.
SUMS = ("elapsed", "distance", *(channel.name for channel in ACCOUNTED), "steps", "touchdowns")

#: All of its rows: the sums, then extremes, then values at the interval's end. `touchdown_time` is
#: the time of the last touchdown since the interval began (s), or -1.
Row = record(
    "Row",
    [
        *SUMS,
        *("min_normal_force", "friction_demand", "impulse_friction_demand", "clearance"),
        *("force_x", "force_y", "failure", "touchdown_time"),
    ],
    __name__,
)

#: The index of each row, as in ``rows[:, ROW.distance]``.
ROW = places(Row)


def balance(energies: Mapping[str, Any]) -> list[Any]:
    """The energies (J) of the balance with their signs; their sum is the residual.

    They are given by name in `CHANNELS`, as numbers or arrays. `push` may be missing.
    """
    signs = {channel.name: channel.sign for channel in CHANNELS if channel.sign}
    return [sign * energies[name] for name, sign in signs.items() if name in energies]


@dataclasses.dataclass(frozen=True)
class Ledger:
    """Where the energy of an interval went (J); `CHANNELS` describes each entry.

    Attributes:
        time: duration (s).
        distance: net travel of the hub along the ground (m), downhill positive.
        losses: energies lost in smooth motion, named as in `rimless_gym.equations.LOSSES`.
    """

    time: float
    distance: float
    electrical: float
    electrical_positive: float
    losses: Any
    collision: float
    shaft: float
    mechanical_change: float
    idle: float
    push: float = 0.0

    @classmethod
    def from_rows(cls, rows: NDArray[np.float64], params: WheelParams) -> Ledger:
        """The ledger of rows (len(ROW),) of the kernel, of one interval or a sum of many."""
        totals = Row(*rows.tolist())
        return cls.of(totals._asdict() | {"idle": params.idle_power * totals.elapsed, "push": 0.0})

    @classmethod
    def of(cls, energies: Mapping[str, float]) -> Ledger:
        """From the channels by name, with `elapsed` and `distance`: entries of `info`, or sums."""
        others = {c.name: energies[c.name] for c in CHANNELS if c.name not in LOSSES}
        losses = Losses(*(energies[name] for name in LOSSES))
        return cls(time=energies["elapsed"], distance=energies["distance"], losses=losses, **others)

    @property
    def residual(self) -> float:
        """What the energy balance leaves unexplained (J)."""
        return float(functools.reduce(operator.add, balance(self._energies())))

    @property
    def energy(self) -> float:
        """E+: drawn from a battery that cannot be recharged, idle power included (J)."""
        return self.electrical_positive + self.idle

    @property
    def energy_with_regeneration(self) -> float:
        """E: drawn from a battery that can be recharged, idle power included (J)."""
        return self.electrical + self.idle

    def cost_of_transport(self, params: WheelParams, *, regeneration: bool = False) -> float:
        """Electrical energy / (weight * distance), without regeneration unless asked for.

        NaN if the hub has not moved forward.
        """
        energy = self.energy_with_regeneration if regeneration else self.energy
        return energy / (params.weight * self.distance) if self.distance > 0 else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Fields and residual as plain JSON values, each loss by its name."""
        return self._energies() | {"residual": self.residual}

    def _energies(self) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            values |= value._asdict() if field.name == "losses" else {field.name: value}
        return values
