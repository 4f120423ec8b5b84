"""The machine's parameters: one frozen dataclass, checked when it is made."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import SMALLEST, real
from rimless_gym.constants import (
    Constants,
    leg_angle_of,
    reach_of,
    shorthand,
    step_length_of,
    weight_of,
)
from rimless_gym.equations import IMPACT_LAWS, equations

MOTOR_MOUNTS = ("wheel", "frame")
MOST_LEGS = 1_000_000  # the model still tells legs apart that are this close
LEAST_REGULARITY = 1e-12  # of the mass matrix, below which it counts as singular
POSITIVE = (
    *("leg_length", "gear_ratio", "armature_resistance", "friction_width"),
    *("gravity", "voltage_limit"),
)
SIGNED = ("slope", "n_legs")  # neither need be at least 0 here: they have limits of their own
OPTIONAL = "pendulum_reach"  # None: it follows from other fields
CHOICES = ("motor_mount", "impact_law")  # the fields that are names; all others are numbers

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


@dataclasses.dataclass(frozen=True, kw_only=True)
class WheelParams:
    """Physical parameters of the actuated rimless wheel, in SI units and radians.

    The fields' defaults are `THESIS_PHYSICAL`, the machine of Mihevc (2015), Table 4.6 and Table
    4.2; the environment's default machine is `BUILDABLE`. No number may exceed 1e30 in size.
    Numbers that must be greater than 0, and the sum of the masses, must be at least 1e-30.

    Args:
        wheel_mass: ``m1`` (kg), >= 0.
        wheel_inertia: ``I1`` about the hub (kg m^2), >= 0.
        leg_length: ``L1`` (m), > 0.
        n_legs: ``n``, an integer >= 3, at most a million.
        pendulum_mass: ``m2`` (kg), >= 0.
        pendulum_inertia: ``I2`` about the pendulum's centre of mass (kg m^2), >= 0.
        pendulum_length: ``L2``, pivot to centre of mass (m), >= 0.
        pendulum_reach: pivot to the pendulum's far end (m), >= ``L2``; by default ``2 L2``, a rod.
        motor_constant: ``Km`` (N m/A), >= 0; 0 is a wheel without a motor.
        gear_ratio: ``N``, > 0.
        armature_resistance: ``Rm`` (ohm), > 0.
        rotor_inertia: ``Jm`` at the motor shaft (kg m^2), >= 0; the hub feels ``Jm N^2``.
        hub_damping: viscous friction torque per unit of psi' (N m s), >= 0.
        hub_friction: dry friction of motor, gear and bearings at the hub without load (N m), >= 0.
        gear_loss: share of a large transmitted torque that the gear loses, in [0, 1): one less
            its efficiency. It needs hub_friction > 0: such a gear has friction without load too.
        friction_width: |psi'| up to which dry friction is nearly viscous (rad/s), > 0; at three
            times this rate it has 95 % of its size.
        drag: air drag force per squared hub speed (N s^2/m^2), >= 0.
        idle_power: drawn from the battery at all times (W), >= 0.
        gravity: acceleration (m/s^2), > 0.
        slope: ``gamma``, downhill positive, in (-pi/2, pi/2).
        friction: coefficient of the ground, >= 0; a higher demand is reported and, in the
            environment, charged, but no foot slips.
        voltage_limit: largest |V| (V), > 0.
        motor_mount: ``"wheel"`` (the machine) or ``"frame"`` (the thesis's simulations).
        impact_law: ``"plastic"``, ``"relabel"`` (the thesis's "perfectly elastic"), or
            ``"thesis"`` (equation 3.82 as printed: not physical, it creates energy).

    Raises:
        ValueError: a value is out of its range or the mass matrix would be singular.
        TypeError: a value is not a number.
    """

    wheel_mass: float = 1.4
    wheel_inertia: float = 0.092
    leg_length: float = 0.375
    n_legs: int = 5
    pendulum_mass: float = 2.22
    pendulum_inertia: float = 2.22 * 0.34**2 / 3
    pendulum_length: float = 0.34
    pendulum_reach: float | None = None
    motor_constant: float = 0.0048
    gear_ratio: float = 505.9
    armature_resistance: float = 5.0
    rotor_inertia: float = 0.0
    hub_damping: float = 0.0
    hub_friction: float = 0.0
    gear_loss: float = 0.0
    friction_width: float = 0.1
    drag: float = 0.0
    idle_power: float = 0.0
    gravity: float = 9.81
    slope: float = 0.0
    friction: float = 1.0
    voltage_limit: float = 20.0
    motor_mount: str = "wheel"
    impact_law: str = "plastic"

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if field.name not in CHOICES and not self._left_open(field.name):
                object.__setattr__(self, field.name, real(field.name, getattr(self, field.name)))
        for name in POSITIVE:
            if getattr(self, name) < SMALLEST:
                raise ValueError(
                    f"{name} = {getattr(self, name)}: must be greater than 0, at least {SMALLEST:g}"
                )
        for field in dataclasses.fields(self):
            if field.name in (*CHOICES, *SIGNED) or self._left_open(field.name):
                continue
            if getattr(self, field.name) < 0:
                raise ValueError(f"{field.name} = {getattr(self, field.name)}: must be at least 0")
        if reach_of(self) < self.pendulum_length:
            raise ValueError(
                f"pendulum_reach = {self.pendulum_reach}: must be at least pendulum_length = "
                f"{self.pendulum_length}, the distance of the centre of mass; change both"
            )
        if self.gear_loss >= 1:
            raise ValueError(
                f"gear_loss = {self.gear_loss}: must be less than 1, a share of torque"
            )
        if self.gear_loss > 0 and self.hub_friction < SMALLEST:
            raise ValueError(
                f"hub_friction = {self.hub_friction}: must be greater than 0 with gear_loss = "
                f"{self.gear_loss}, because a gear that loses torque under load also has friction "
                "without load"
            )
        if not (3 <= self.n_legs <= MOST_LEGS and self.n_legs == int(self.n_legs)):
            raise ValueError(
                f"n_legs = {self.n_legs:.15g}: must be an integer of at least 3, and at most "
                f"{MOST_LEGS}"
            )
        object.__setattr__(self, "n_legs", int(self.n_legs))
        if abs(self.slope) >= math.pi / 2:
            raise ValueError(f"slope = {self.slope}: must lie strictly between -pi/2 and pi/2 rad")
        for name in CHOICES:
            if not isinstance(getattr(self, name), str):
                raise TypeError(f"{name} = {getattr(self, name)!r}: must be a name")
        if self.motor_mount not in MOTOR_MOUNTS:
            raise ValueError(f"motor_mount = {self.motor_mount!r}: choose from {MOTOR_MOUNTS}")
        if self.impact_law not in IMPACT_LAWS:
            raise ValueError(f"impact_law = {self.impact_law!r}: choose from {IMPACT_LAWS}")
        self._require_regular_mass_matrix()

    def _left_open(self, name: str) -> bool:
        return name == OPTIONAL and getattr(self, name) is None

    def _require_regular_mass_matrix(self) -> None:
        if self.total_mass < SMALLEST:
            raise ValueError(
                f"wheel_mass + pendulum_mass = {self.total_mass:g}: one of them must be greater "
                f"than 0, at least {SMALLEST:g}"
            )
        if self._is_singular():
            hub = self.rotor_inertia * self.gear_ratio**2
            if hub > 0 and self._is_regular_without_rotor():
                raise ValueError(
                    f"rotor_inertia = {self.rotor_inertia:g}: with gear_ratio = "
                    f"{self.gear_ratio:g} the hub feels {hub:.3g} kg m^2, so much that the wheel's "
                    "and the pendulum's own inertias are lost in rounding: lower rotor_inertia or "
                    "gear_ratio"
                )
            raise ValueError(
                "the mass matrix is singular for these masses and inertias: give the pendulum "
                "an inertia (pendulum_inertia > 0, or pendulum_mass and pendulum_length > 0) "
                "and the wheel a mass or an inertia (wheel_mass or wheel_inertia > 0)"
            )

    def _is_regular_without_rotor(self) -> bool:
        try:
            self.replace(rotor_inertia=0.0)
        except ValueError:
            return False
        return True

    def _is_singular(self) -> bool:
        """Whether the mass matrix in single stance is (nearly) singular, with or without rotor."""
        pendulum = self.pendulum_mass * self.pendulum_length**2 + self.pendulum_inertia
        if pendulum + self.rotor_inertia * self.gear_ratio**2 < SMALLEST**4:
            return True
        return bool(_eq.least_regularity(self.constants) <= LEAST_REGULARITY)

    @property
    def total_mass(self) -> float:
        """``m1 + m2`` (kg)."""
        return self.wheel_mass + self.pendulum_mass

    @property
    def weight(self) -> float:
        """``(m1 + m2) g`` (N)."""
        return float(weight_of(self))

    @property
    def leg_angle(self) -> float:
        """``alpha = 2 pi / n`` between neighbouring legs (rad)."""
        return float(leg_angle_of(self))

    @property
    def step_length(self) -> float:
        """Distance between neighbouring feet (m)."""
        return float(step_length_of(self))

    @cached_property
    def constants(self) -> Constants:
        """The equations' shorthand as plain floats."""
        return shorthand(self)

    @cached_property
    def constants_array(self) -> NDArray[np.float64]:
        """`constants` as a read-only float64 array of shape (N_CONSTANTS,)."""
        array = np.array(self.constants, dtype=np.float64)
        array.setflags(write=False)
        return array

    @cached_property
    def motor_pole(self) -> float:
        """Fastest rate (1/s) at which back-EMF and viscous friction damp psi', over all poses."""
        return float(_eq.hub_pole(self.constants))

    def replace(self, /, **changes: Any) -> WheelParams:
        """A copy with some fields changed, validated like a new one.

        Raises:
            ValueError: a name is not a field, or a value is out of its range.
        """
        known = [field.name for field in dataclasses.fields(self)]
        for name in changes:
            if name not in known:
                raise ValueError(f"{name!r} is not a field of WheelParams: choose from {known}")
        return dataclasses.replace(self, **changes)

    def differences(self, wanted: WheelParams) -> dict[str, str]:
        """What differs from another machine, by field: "value (not the other's)"."""
        has, other = self.to_dict(), wanted.to_dict()
        return {k: f"{has[k]} (not {other[k]})" for k in has if has[k] != other[k]}

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values; ``WheelParams(**d)`` is the inverse."""
        return dataclasses.asdict(self)
