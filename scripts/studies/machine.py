"""What BUILDABLE is made of: parts with their data-sheet numbers, and the machine that they make.

docs/machine.md names every source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE

#: The motor: precious-metal brushes, ball bearings, 12 V winding.
MOTOR = "maxon DCX 22 L EB KL, 12 V"
MOTOR_CONSTANT = 0.0229  # N m/A
MOTOR_RESISTANCE = 1.84  # of the terminals, winding at 25 C (ohm)
ROTOR_INERTIA = 9.0e-7  # kg m^2
NO_LOAD_CURRENT = 0.020  # at nominal voltage (A)
MOTOR_MASS = 0.095  # kg
TOP_SPEED = 749.8  # of the shaft (rad/s)

#: The planetary gearhead, which the maker combines with this motor.
GEARHEAD = "maxon GPX 22 UP 21:1"
GEAR_RATIO = 20.95  # exact reduction
GEAR_EFFICIENCY = 0.93  # largest
GEAR_INERTIA = 6e-8  # at the motor's shaft (kg m^2)
GEAR_MASS = 0.078  # kg
GEAR_TORQUE = 2.9  # permissible at the output, continuously (N m)

#: Dry torque of the gearhead at its input (N m), which no data sheet gives: as much as the motor's.
GEAR_DRY_TORQUE = 0.46e-3

#: Resistance of the driver's transistors, two of them in series, and of the cables (ohm).
DRIVER_RESISTANCE = 0.06

#: Of the battery when it is nearly empty, which is the motor's nominal voltage too (V).
VOLTAGE = 12.0

#: Drawn at all times (W): driver, microcontroller, sensors, radio, converter.
ELECTRONICS_POWER = 0.5

#: Dry torque of the two ball bearings that carry the arm (N m).
BEARING_TORQUE = 0.002

TOTAL_MASS = 3.0  # kg
LEGS = 7
LEG_LENGTH = 0.3  # m: the machine stands on a table
FRICTION = 0.8  # coefficient of the ground that gaits may use

TUBE = 0.0535  # kg/m: carbon fibre, 12 mm outside and 10 mm inside, 1550 kg/m^3
HUB_RADIUS = 0.04  # m, where the legs begin
SOCKET, FOOT, CROSSBAR = 0.010, 0.010, 0.008  # kg: at the hub, at the tip, between two tips
BOB_RADIUS = 0.020  # m: steel round bar of 40 mm, cut to the wanted mass
CLAMP = 0.05  # kg: of the arm on its bearings, at the hub

#: Parts of the wheel close to the hub: kg, and distance (m) at which their mass may be thought to
#: lie.
HUB_PARTS: Mapping[str, tuple[float, float]] = {
    f"motor: {MOTOR}": (MOTOR_MASS, 0.011 / math.sqrt(2)),
    f"gearhead: {GEARHEAD}": (GEAR_MASS, 0.011 / math.sqrt(2)),
    "battery: 4 cells LiFePO4 26650, holder": (0.300, 0.040),
    "electronics and cables": (0.100, 0.040),
    "two hub plates, spacers, motor mount": (0.200, 0.035),
    "axle, two bearings, coupling": (0.060, 0.010),
}


def machine(bob: float, arm: float) -> WheelParams:
    """The machine with a bob (kg), a bar across the end of an arm (m), a tube on a clamp.

    What it lacks of its total mass is payload at the hub.
    """
    tube = TUBE * arm
    mass = bob + tube + CLAMP
    length = (bob * arm + tube * arm / 2) / mass
    about_hub = bob * (arm**2 + BOB_RADIUS**2 / 2) + tube * arm**2 / 3
    dry_torque = MOTOR_CONSTANT * NO_LOAD_CURRENT + GEAR_DRY_TORQUE
    return WheelParams(
        wheel_mass=TOTAL_MASS - mass,
        wheel_inertia=sum(inertia for _, inertia in wheel_parts().values()),
        leg_length=LEG_LENGTH,
        n_legs=LEGS,
        pendulum_mass=mass,
        pendulum_length=length,
        pendulum_inertia=about_hub - mass * length**2,
        pendulum_reach=arm + BOB_RADIUS,
        motor_constant=MOTOR_CONSTANT,
        gear_ratio=GEAR_RATIO,
        armature_resistance=MOTOR_RESISTANCE + DRIVER_RESISTANCE,
        rotor_inertia=ROTOR_INERTIA + GEAR_INERTIA,
        hub_friction=GEAR_RATIO * dry_torque + BEARING_TORQUE,
        gear_loss=1 - GEAR_EFFICIENCY,
        idle_power=ELECTRONICS_POWER,
        friction=FRICTION,
        voltage_limit=VOLTAGE,
    )


def wheel_parts() -> dict[str, tuple[float, float]]:
    """Mass (kg) and moment of inertia about the hub (kg m^2) of every part of the wheel."""
    inner, outer = HUB_RADIUS, LEG_LENGTH - 0.005
    tube, tips = TUBE * (outer - inner), LEGS * (2 * FOOT + CROSSBAR)
    parts = {name: (mass, mass * r**2) for name, (mass, r) in HUB_PARTS.items()}
    parts["legs: carbon tubes"] = (
        2 * LEGS * tube,
        2 * LEGS * tube * (inner**2 + inner * outer + outer**2) / 3,
    )
    parts["leg sockets"] = (2 * LEGS * SOCKET, 2 * LEGS * SOCKET * inner**2)
    parts["rubber feet and crossbars"] = (tips, tips * outer**2)
    return parts


def chosen() -> tuple[float, float]:
    """Bob (kg) and arm (m) of the preset."""
    assert BUILDABLE.pendulum_reach is not None
    arm = BUILDABLE.pendulum_reach - BOB_RADIUS
    return BUILDABLE.pendulum_mass - CLAMP - TUBE * arm, arm


def budget() -> list[list[str]]:
    """The masses of the preset's parts (g), and their sum."""
    bob, arm = chosen()
    parts = {name: mass for name, (mass, _) in wheel_parts().items()}
    parts["bob: steel bar"] = bob
    parts[f"arm of {1000 * arm:.0f} mm and its clamp"] = BUILDABLE.pendulum_mass - bob
    parts["left for payload, at the hub"] = TOTAL_MASS - sum(parts.values())
    rows = [[name, f"{1000 * mass:.0f}"] for name, mass in parts.items()]
    return [*rows, ["**sum**", f"**{1000 * sum(parts.values()):.0f}**"]]
