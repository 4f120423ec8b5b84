"""Energy bookkeeping: the ledger of an interval, and cost of transport. One definition everywhere.

Over any interval, whatever the motion,

    electrical = copper + friction + drag + collision + (change of mechanical energy)

with the foot's own descent in the mechanical energy. `Ledger.residual` is what is left over.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.params import WheelParams

# Rows of the array that the stepping kernel fills; the first of them are a Ledger's fields.
# TOUCHDOWN_TIME is when in the interval the last touchdown was (s), or -1.
(
    TIME,
    DISTANCE,
    ELECTRICAL,
    ELECTRICAL_POSITIVE,
    COPPER,
    FRICTION,
    DRAG,
    COLLISION,
    SHAFT,
    MECHANICAL_CHANGE,
    STEPS,
    TOUCHDOWNS,
    MIN_NORMAL_FORCE,
    FRICTION_DEMAND,
    IMPULSE_FRICTION_DEMAND,
    CLEARANCE,
    FORCE_X,
    FORCE_Y,
    FAILURE,
    TOUCHDOWN_TIME,
    N_ROWS,
) = range(21)


@dataclasses.dataclass(frozen=True)
class Ledger:
    """Where the energy of an interval went (J), with its duration (s) and distance (m).

    Attributes:
        time: duration (s).
        distance: net travel of the hub along the ground (m), downhill positive.
        electrical: integral of V i; the battery can be recharged.
        electrical_positive: integral of max(V i, 0); it cannot.
        copper: integral of i^2 Rm.
        friction: loss to viscous hub friction.
        drag: loss to air drag.
        collision: loss in touchdowns (signed under the non-physical impact laws).
        shaft: integral of |T psi'|, the thesis's measure.
        mechanical_change: change of kinetic and potential energy, foot descent included.
        idle: idle power times duration.
    """

    time: float
    distance: float
    electrical: float
    electrical_positive: float
    copper: float
    friction: float
    drag: float
    collision: float
    shaft: float
    mechanical_change: float
    idle: float

    @classmethod
    def from_rows(cls, rows: NDArray[np.float64], params: WheelParams) -> Ledger:
        """From the first rows of the kernel's output array (summed over intervals or not)."""
        names = [field.name for field in dataclasses.fields(cls)][: MECHANICAL_CHANGE + 1]
        values = dict(zip(names, rows.tolist(), strict=False))
        return cls(**values, idle=params.idle_power * values["time"])

    @property
    def residual(self) -> float:
        """What the energy balance leaves unexplained (J)."""
        spent = self.copper + self.friction + self.drag + self.collision
        return self.electrical - spent - self.mechanical_change

    @property
    def energy(self) -> float:
        """E+: drawn from a battery that cannot be recharged, idle power included (J)."""
        return self.electrical_positive + self.idle

    @property
    def energy_with_regeneration(self) -> float:
        """E: drawn from a battery that can be recharged, idle power included (J)."""
        return self.electrical + self.idle

    def cost_of_transport(self, params: WheelParams, *, regeneration: bool = False) -> float:
        """Energy / (weight * distance), electrical, without regeneration unless asked for.

        NaN if the hub did not get forward.
        """
        energy = self.energy_with_regeneration if regeneration else self.energy
        return energy / (params.weight * self.distance) if self.distance > 0 else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Fields and residual as plain JSON values."""
        return dataclasses.asdict(self) | {"residual": self.residual}
