"""What a picture shows of a machine, and where its parts are."""

from __future__ import annotations

import cmath
import dataclasses
import math

from rimless_gym.equations import SINGLE, equations
from rimless_gym.params import WheelParams

Point = tuple[float, float]
_hub_position = equations(math.sin, math.cos).hub_position  # interpreted: nothing to compile


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """What one frame shows.

    Args:
        phi: stance leg's angle from the ground (rad); in double stance the leading leg's.
        theta: pendulum's angle from the ground's normal (rad).
        mode: `rimless_gym.equations.SINGLE` or `DOUBLE`; decides which feet light up.
        foot_x: stance foot's position along the ground (m).
        voltage: motor voltage (V), shown as a bar; None leaves it out, as for the texts below.
        time: time (s), shown as text.
        speed: walking speed (m/s), shown as text.
        cot: cost of transport, shown as text.
        averaged: over what speed and cost are averaged, shown as text.
    """

    phi: float
    theta: float
    mode: int = SINGLE
    foot_x: float = 0.0
    voltage: float | None = None
    time: float | None = None
    speed: float | None = None
    cot: float | None = None
    averaged: str | None = None

    def hub(self, params: WheelParams) -> Point:
        """The hub's position in the ground's frame (m), as `draw` takes it in its `trail`."""
        x, y = _hub_position(self.phi, params.constants)
        return self.foot_x + x, y

    def pendulum(self, params: WheelParams) -> tuple[complex, complex, complex]:
        """Hub, centre of mass of the pendulum and its far end, x + iy in the ground's frame (m)."""
        hub, along = complex(*self.hub(params)), -1j * cmath.exp(1j * self.theta)
        return hub, hub + params.pendulum_length * along, hub + params.constants.reach * along
