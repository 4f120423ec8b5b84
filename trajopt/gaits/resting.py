"""Where a wheel should rather walk faster and rest in between: a bound that any front gives.

Resting draws the idle power alone. A wheel that walks at a speed v for a share s/v of the time and
rests for the remainder travels at the mean speed s. Per weight and distance that takes

    cot(v) + idle_power / weight (1 / s - 1 / v).

The stop and the restart are taken to cost nothing, and they do cost something. So this is a bound:
where it is not below the front, resting does not pay; where it is, resting may pay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import real_array
from trajopt.ocp.arrays import Array
from trajopt.ocp.ranking import clearly_less


class Rest(NamedTuple):
    """Walking faster than a mean speed, and resting in between.

    Attributes:
        speed: mean speed (m/s).
        walking: speed while walking (m/s), more than `speed`.
        share: of the time that is spent walking, between 0 and 1.
        cot: least cost of transport, the stops and restarts free.
    """

    speed: float
    walking: float
    share: float
    cot: float


def rests(
    speeds: ArrayLike, cots: ArrayLike, weight: float, idle_power: float
) -> tuple[Rest | None, ...]:
    """For every speed of a front the best rest, or None where walking on is no dearer.

    Args:
        speeds: of the front (m/s), ascending, shape (N,).
        cots: its cost of transport at these, idle power included, shape (N,).
        weight: of the machine (N).
        idle_power: drawn at all times (W).

    Raises:
        ValueError: the speeds are not positive and ascending, or the shapes differ.
    """
    speeds, cots = real_array("speeds", speeds), real_array("cots", cots)
    if speeds.ndim != 1 or speeds.shape != cots.shape:
        raise ValueError(
            f"speeds of shape {speeds.shape} and cots of shape {cots.shape}: give a row of each, "
            "equally long"
        )
    if np.any(speeds <= 0.0) or np.any(np.diff(speeds) <= 0.0):
        raise ValueError(f"speeds = {speeds}: must be greater than 0 and ascend")
    return tuple(_best(i, speeds, cots, idle_power / weight) for i in range(len(speeds)))


def _best(i: int, speeds: Array, cots: Array, idle: float) -> Rest | None:
    s, v = float(speeds[i]), speeds[i + 1 :]
    costs: Sequence[float] = (cots[i + 1 :] + idle * (1 / s - 1 / v)).tolist()
    if not costs or not clearly_less(min(costs), float(cots[i])):
        return None
    best = int(np.argmin(costs))
    return Rest(s, float(v[best]), s / float(v[best]), float(costs[best]))
