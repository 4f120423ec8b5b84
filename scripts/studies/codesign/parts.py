"""Parts that can be bought, with their data-sheet numbers; docs/machine.md names every source."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Motor:
    """A brushed DC motor.

    Attributes:
        name: of the manufacturer.
        constant: torque constant (N m/A).
        resistance: of the terminals, winding at 25 C (ohm).
        inertia: of the rotor (kg m^2).
        no_load_current: at nominal voltage (A).
        mass: kg.
        top_speed: of the shaft (rad/s).
    """

    name: str
    constant: float
    resistance: float
    inertia: float
    no_load_current: float
    mass: float
    top_speed: float

    @property
    def dry_torque(self) -> float:
        """Friction torque at the shaft (N m), from the no-load current."""
        return self.constant * self.no_load_current


@dataclasses.dataclass(frozen=True)
class Gearhead:
    """A planetary gearhead of one reduction.

    Attributes:
        name: of the manufacturer.
        ratio: exact reduction.
        efficiency: largest, in (0, 1).
        inertia: at the motor's shaft (kg m^2).
        mass: kg.
        continuous_torque: permissible at the output (N m).
        intermittent_torque: permissible at the output for short times (N m).
    """

    name: str
    ratio: float
    efficiency: float
    inertia: float
    mass: float
    continuous_torque: float
    intermittent_torque: float


#: maxon DCX 22 L, precious-metal brushes, ball bearings, 12 V winding.
DCX_22_L = Motor(
    name="maxon DCX 22 L EB KL, 12 V",
    constant=0.0229,
    resistance=1.84,
    inertia=9.0e-7,
    no_load_current=0.020,
    mass=0.095,
    top_speed=749.8,
)


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
