"""Machines between the one that was simulated and the one that was built, and their supplies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from rimless_gym.params import WheelParams
from rimless_gym.presets import PROTOTYPE
from rimless_gym.symbolic import Design
from trajopt.gaits.problem import designed_gait
from trajopt.gaits.solution import Solution
from trajopt.ocp.constraints import pair
from trajopt.ocp.problem import Problem

#: Mass and length of the pendulum in units of those as built; 4 is the machine of Table 4.6.
SCALES = (4.0, 3.5, 3.0, 2.5, 2.0, 1.75, 1.6, 1.5, 1.4, 1.3, 1.2, 1.15, 1.1, 1.0)

#: Bounds on the mean speed (m/s); a slower wheel would balance for seconds in every step.
SPEEDS = (0.1, 0.7)

#: Bounds on a gear ratio that is to be chosen, in units of the ratio as built.
GEARS = (0.02, 20.0)


def scaled(p: Any) -> Mapping[str, Any]:
    """Fields of a machine whose pendulum, a rod, is scaled by p[0], and its gear ratio by p[1]."""
    mass, length = p[0] * PROTOTYPE.pendulum_mass, p[0] * PROTOTYPE.pendulum_length
    return {
        "pendulum_mass": mass,
        "pendulum_length": length,
        "pendulum_inertia": mass * length**2 / 3,
        "gear_ratio": p[1] * PROTOTYPE.gear_ratio,
    }


DESIGN = Design(("scale", "gear"), scaled)


@dataclasses.dataclass(frozen=True)
class Variant:
    """A motor supply and gear.

    Attributes:
        name: as in tables.
        voltage: largest (V).
        gear: ratio in units of the one as built, or bounds on it.
    """

    name: str
    voltage: float
    gear: float | tuple[float, float] = 1.0

    @property
    def params(self) -> WheelParams:
        """The machine as built, with this supply."""
        return PROTOTYPE.replace(voltage_limit=self.voltage)

    @property
    def file_name(self) -> str:
        """The name as files and folders have it."""
        return self.name.replace(" ", "_").replace(",", "")

    def machine(self, scale: float, gear: float) -> WheelParams:
        """The machine of a scale and gear ratio."""
        return DESIGN.machine(self.params, (scale, gear))

    def scale_and_gear(self, gait: Solution) -> tuple[float, float]:
        """Scale and gear ratio of a gait's machine."""
        built = self.params
        scale = gait.params.pendulum_length / built.pendulum_length
        return scale, gait.params.gear_ratio / built.gear_ratio

    def admits(self, other: Variant) -> bool:
        """Whether every gait of another supply and gear is possible with this one too."""
        (low, high), (least, most) = pair(self.gear), pair(other.gear)
        return self.voltage >= other.voltage and low <= least and most <= high

    def problem(self, scale: float | tuple[float, float], turns: int) -> Problem:
        """The problem of a periodic step of least cost of transport at any speed.

        Args:
            scale: of the pendulum.
            turns: of theta per step.
        """
        ring = _ring(self.voltage)
        link = dataclasses.replace(ring.linkages[0], offset=_offset(turns))
        bounds = {"scale": scale, "gear": self.gear}
        return dataclasses.replace(ring, linkages=(link,), parameters=bounds)


VARIANTS = (
    Variant("20 V", 20.0),
    Variant("65 V", 65.0),
    Variant("20 V, gear ratio free", 20.0, GEARS),
)


@lru_cache(maxsize=4)
def _ring(voltage: float) -> Problem:
    params = PROTOTYPE.replace(voltage_limit=voltage)
    slow, fast = SPEEDS
    return designed_gait(
        *(params, DESIGN, {"scale": (0.1, 10.0), "gear": GEARS}),
        steps=1,
        duration=(params.step_length / fast, params.step_length / slow),
    )


def _offset(turns: int) -> dict[str, float]:
    return {"theta": -2 * math.pi * turns}
