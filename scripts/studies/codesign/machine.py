"""What can be built: parts with their data-sheet numbers, and the machines that follow from them.

docs/machine.md names every source.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from rimless_gym.rules import least_clearance
from rimless_gym.symbolic import Design


@dataclasses.dataclass(frozen=True)
class Gearhead:
    """A planetary gearhead of one reduction."""

    name: str  # of the manufacturer
    ratio: float  # exact reduction
    efficiency: float  # largest, in (0, 1)
    inertia: float  # at the motor's shaft (kg m^2)
    mass: float  # kg
    continuous_torque: float  # permissible at the output (N m)
    intermittent_torque: float  # permissible at the output for short times (N m)


#: The motor: precious-metal brushes, ball bearings, 12 V winding.
MOTOR = "maxon DCX 22 L EB KL, 12 V"
MOTOR_CONSTANT = 0.0229  # N m/A
MOTOR_RESISTANCE = 1.84  # of the terminals, winding at 25 C (ohm)
ROTOR_INERTIA = 9.0e-7  # kg m^2
NO_LOAD_CURRENT = 0.020  # at nominal voltage (A)
MOTOR_MASS = 0.095  # kg
TOP_SPEED = 749.8  # of the shaft (rad/s)


def _gpx_22_up(ratio: float, stages: int) -> Gearhead:
    """A maxon GPX 22 UP ("ultra performance") gearhead."""
    two = stages == 2
    return Gearhead(
        name=f"maxon GPX 22 UP {ratio:.0f}:1",
        ratio=ratio,
        efficiency=0.93 if two else 0.90,
        inertia=6e-8,
        mass=0.078 if two else 0.095,
        continuous_torque=2.9 if two else 4.3,
        intermittent_torque=3.6 if two else 5.3,
    )


#: Gearheads that the maker combines with this motor, up to a ratio that is clearly too high.
GPX_22_UP = (
    _gpx_22_up(15.58, 2),
    _gpx_22_up(20.95, 2),
    _gpx_22_up(28.17, 2),
    _gpx_22_up(35.03, 2),
    _gpx_22_up(61.51, 3),
)

#: Resistance of the driver's transistors, two of them in series, and of the cables (ohm).
DRIVER_RESISTANCE = 0.06

#: Of the battery when it is nearly empty, which is the motor's nominal voltage too (V).
VOLTAGE = 12.0

#: Drawn at all times (W): driver, microcontroller, sensors, radio, converter.
ELECTRONICS_POWER = 0.5

#: Dry torque of the gearhead at its input (N m), which no data sheet gives: as much as the motor's.
GEAR_DRY_TORQUE = 0.46e-3

#: Dry torque of the two ball bearings that carry the arm (N m).
BEARING_TORQUE = 0.002

TOTAL_MASS = 3.0  # kg
LEG_LENGTH = 0.3  # m: the machine stands on a table
CLEARANCE = 0.010  # m, between the floor and the bob in the lowest pose
ROUNDING = 1e-5  # m, by which a solver may come closer
FRICTION = 0.8  # coefficient of the ground that gaits may use
GRAVITY = WheelParams.gravity  # m/s^2

TUBE = 0.0535  # kg/m: carbon fibre, 12 mm outside and 10 mm inside, 1550 kg/m^3
HUB_RADIUS = 0.04  # m, where the legs begin
SOCKET, FOOT, CROSSBAR = 0.010, 0.010, 0.008  # kg: at the hub, at the tip, between two tips
BOB_RADIUS = 0.020  # m: steel round bar of 40 mm, cut to the wanted mass
CLAMP = 0.05  # kg: of the arm on its bearings, at the hub

#: Parts of the wheel close to the hub, without motor and gearhead: kg, and distance (m) at which
#: their mass may be thought to lie.
HUB_PARTS: Mapping[str, tuple[float, float]] = {
    "battery: 4 cells LiFePO4 26650, holder": (0.300, 0.040),
    "electronics and cables": (0.100, 0.040),
    "two hub plates, spacers, motor mount": (0.200, 0.035),
    "axle, two bearings, coupling": (0.060, 0.010),
}


@dataclasses.dataclass(frozen=True)
class Build:
    """A machine without its pendulum: gearhead and number of legs."""

    gearhead: Gearhead
    n_legs: int

    @property
    def longest_arm(self) -> float:
        """From the hub to the bob's axis (m), so that the bob clears the floor in every pose."""
        return LEG_LENGTH * math.cos(math.pi / self.n_legs) - CLEARANCE - BOB_RADIUS

    def wheel_parts(self) -> dict[str, tuple[float, float]]:
        """Mass (kg) and moment of inertia about the hub (kg m^2) of every part of the wheel."""
        inner, outer, pairs = HUB_RADIUS, LEG_LENGTH - 0.005, self.n_legs
        tube = TUBE * (outer - inner)
        discs = {
            f"motor: {MOTOR}": MOTOR_MASS,
            f"gearhead: {self.gearhead.name}": self.gearhead.mass,
        }
        rows = {name: (mass, mass * 0.011**2 / 2) for name, mass in discs.items()}
        rows |= {name: (mass, mass * r**2) for name, (mass, r) in HUB_PARTS.items()}
        rows["legs: carbon tubes"] = (
            2 * pairs * tube,
            2 * pairs * tube * (inner**2 + inner * outer + outer**2) / 3,
        )
        rows["leg sockets"] = (2 * pairs * SOCKET, 2 * pairs * SOCKET * inner**2)
        tips = pairs * (2 * FOOT + CROSSBAR)
        rows["rubber feet and crossbars"] = (tips, tips * outer**2)
        return rows

    def pendulum(self, p: Any) -> Mapping[str, Any]:
        """The fields of `WheelParams` that follow from p = (mass of the bob, length of the arm).

        The arm is a tube on a clamp with bearings; the bob is a bar across it. What the machine
        lacks of its total mass is payload at the hub. Numbers, or CasADi's symbols.
        """
        bob, arm = p[0], p[1]
        tube = TUBE * arm
        mass = bob + tube + CLAMP
        length = (bob * arm + tube * arm / 2) / mass
        about_hub = bob * (arm**2 + BOB_RADIUS**2 / 2) + tube * arm**2 / 3
        return {
            "wheel_mass": TOTAL_MASS - mass,
            "pendulum_mass": mass,
            "pendulum_length": length,
            "pendulum_inertia": about_hub - mass * length**2,
            "pendulum_reach": arm + BOB_RADIUS,
        }

    @property
    def heaviest_bob(self) -> float:
        """What the total mass leaves for the bob when there is no payload (kg)."""
        wheel = sum(mass for mass, _ in self.wheel_parts().values())
        return TOTAL_MASS - wheel - CLAMP - TUBE * self.longest_arm

    def machine(self, bob: float, arm: float) -> WheelParams:
        """The machine with a bob (kg) and an arm (m)."""
        gear = self.gearhead
        dry_torque = MOTOR_CONSTANT * NO_LOAD_CURRENT + GEAR_DRY_TORQUE
        params = WheelParams(
            **self.pendulum((bob, arm)),
            wheel_inertia=sum(inertia for _, inertia in self.wheel_parts().values()),
            leg_length=LEG_LENGTH,
            n_legs=self.n_legs,
            motor_constant=MOTOR_CONSTANT,
            gear_ratio=gear.ratio,
            armature_resistance=MOTOR_RESISTANCE + DRIVER_RESISTANCE,
            rotor_inertia=ROTOR_INERTIA + gear.inertia,
            hub_friction=gear.ratio * dry_torque + BEARING_TORQUE,
            gear_loss=1 - gear.efficiency,
            idle_power=ELECTRONICS_POWER,
            friction=FRICTION,
            voltage_limit=VOLTAGE,
        )
        if least_clearance(params) < CLEARANCE - ROUNDING:
            raise ValueError(
                f"clearance = {least_clearance(params):.4g} m: must be at least {CLEARANCE:.4g} m; "
                "shorten the arm"
            )
        return params

    @property
    def design(self) -> Design:
        """Mass of the bob (kg) and length of the arm (m) as design variables."""
        return Design(("bob", "arm"), self.pendulum)

    def holding_torque(self, p: Any) -> Any:
        """Torque (N m) that holds the pendulum level, for p as in `pendulum`."""
        fields = self.pendulum(p)
        return fields["pendulum_mass"] * GRAVITY * fields["pendulum_length"]

    def lifting_torque(self) -> float:
        """Torque (N m) at full voltage from standstill, within what the gearhead endures."""
        gear = self.gearhead
        stall = MOTOR_CONSTANT * VOLTAGE / (MOTOR_RESISTANCE + DRIVER_RESISTANCE)
        return min(gear.efficiency * gear.ratio * stall, gear.intermittent_torque)


def chosen(params: WheelParams) -> tuple[float, float]:
    """Bob (kg) and arm (m) of a machine of the study."""
    given = params.pendulum_reach
    arm = (2 * params.pendulum_length if given is None else given) - BOB_RADIUS
    return params.pendulum_mass - CLAMP - TUBE * arm, arm


def preset_build() -> Build:
    """The build of the preset."""
    gear = min(GPX_22_UP, key=lambda g: abs(g.ratio - BUILDABLE.gear_ratio))
    return Build(gear, BUILDABLE.n_legs)
