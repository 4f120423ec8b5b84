"""The thesis's bounds (tables 4.3 to 4.7) and costs (4.3 to 4.12), in SI units and radians."""

from __future__ import annotations

import dataclasses
from math import pi
from typing import Any

#: Least phi' at the end of the last step (rad/s), where the thesis asks for more than 0.
LEAST_TOUCHDOWN_RATE = 0.01

#: Bounds at the start, throughout, and at the end.
Rows = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def symmetric(start: float, along: float, end: float) -> Rows:
    """[-x, x] for each x: most bounds of the thesis are symmetric."""
    return (-start, start), (-along, along), (-end, end)


@dataclasses.dataclass(frozen=True)
class Table:
    """Bounds of one of the tables 4.3, 4.4, 4.5 and 4.7.

    Attributes:
        rate: of phi' (rad/s).
        swing: of theta' (rad/s).
        pendulum: largest |theta| (rad).
        voltage: largest |V| (V).
        duration: of the whole motion (s).
    """

    rate: Rows
    swing: Rows
    pendulum: float
    voltage: float
    duration: tuple[float, float]

    def row(self, where: int) -> dict[str, float | tuple[float, float]]:
        """Bounds on the rates and theta at the start (0), throughout (1) or at the end (2)."""
        theta = (-self.pendulum, self.pendulum)
        return {"theta": theta, "phi'": self.rate[where], "theta'": self.swing[where]}


@dataclasses.dataclass(frozen=True)
class Weights:
    """A running cost: weights on the squares of phi, phi', theta, theta' and V."""

    phi: float
    rate: float
    theta: float
    swing: float
    voltage: float

    def __call__(self, x: Any, u: Any, p: Any) -> Any:
        """The running cost."""
        states = self.phi, self.theta, self.rate, self.swing  # in the order of `STATES`
        return sum(w * x[i] ** 2 for i, w in enumerate(states)) + self.voltage * u[0] ** 2


WIDE = (-2 * pi, 4 * pi)
TABLE_4_3 = Table(
    rate=((0.0, pi), WIDE, WIDE),
    swing=symmetric(3 * pi, 3 * pi, 3 * pi),
    pendulum=2 * pi,
    voltage=20.0,
    duration=(0.1, 100.0),
)
TABLE_4_4 = Table(
    rate=((0.0, pi), WIDE, (0.0, 0.0)),
    swing=symmetric(8 * pi, 8 * pi, 3 * pi),
    pendulum=2 * pi,
    voltage=20.0,
    duration=(0.1, 100.0),
)
TABLE_4_5 = Table(
    rate=((0.5, 2.5), (-5.0, 10.0), (LEAST_TOUCHDOWN_RATE, 10.0)),
    swing=symmetric(8.0, 8.0, 8.0),
    pendulum=2 * pi,
    voltage=20.0,
    duration=(0.1, 100.0),
)
TABLE_4_7 = Table(
    rate=((0.5, 10.0), (-5.0, 10.0), (LEAST_TOUCHDOWN_RATE, 10.0)),
    swing=symmetric(15.0, 15.0, 15.0),
    pendulum=5 * pi,
    voltage=65.0,
    duration=(0.1, 12.0),
)

#: phi, phi', theta, theta', V
COST_4_3 = Weights(0.0, 0.0, 0.0, 0.0, 1.0)
COST_4_4 = Weights(0.01, 0.01, 0.01, 0.1, 100.0)
COST_4_5 = Weights(0.01, 0.01, 0.01, 0.01, 100.0)
COST_4_6 = Weights(0.1, 1.0, 1.0, 1.0, 1.0)
COST_4_7 = Weights(0.1, 0.1, 1.0, 1.0, 1.0)
COST_4_8 = Weights(0.1, 1.0, 0.1, 1.0, 1.0)
COST_4_9 = Weights(0.1, 1.0, 0.1, 0.1, 1.0)
COST_4_12 = Weights(1.0, 0.1, 0.1, 0.1, 1.0)
