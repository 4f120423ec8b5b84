"""Machines with names, and the forms in which users may give a machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from rimless_gym.params import WheelParams

#: A machine that can be built from catalogue parts, the default; docs/machine.md has sources and
#: budget.
BUILDABLE = WheelParams()

#: Thesis, Table 4.6, with the motor of Table 4.2, whose losses are the only ones.
THESIS_PHYSICAL = WheelParams(
    wheel_mass=1.4,
    wheel_inertia=0.092,
    leg_length=0.375,
    n_legs=5,
    pendulum_mass=2.22,
    pendulum_inertia=2.22 * 0.34**2 / 3,
    pendulum_length=0.34,
    pendulum_reach=None,
    motor_constant=0.0048,
    gear_ratio=505.9,
    armature_resistance=5.0,
    rotor_inertia=0.0,
    hub_friction=0.0,
    gear_loss=0.0,
    idle_power=0.0,
    friction=1.0,
    voltage_limit=20.0,
)

#: Thesis, Table 4.1 with the same motor.
THESIS_NOMINAL = THESIS_PHYSICAL.replace(
    wheel_mass=1.0,
    wheel_inertia=1.0,
    leg_length=1.0,
    pendulum_mass=1.0,
    pendulum_inertia=1.0,
    pendulum_length=0.5,
)

#: The machine as built: pendulum mass and length a quarter of Table 4.6's.
PROTOTYPE = THESIS_PHYSICAL.replace(
    pendulum_mass=0.555, pendulum_inertia=0.555 * 0.085**2 / 3, pendulum_length=0.085
)

PRESETS = {
    "BUILDABLE": BUILDABLE,
    "THESIS_NOMINAL": THESIS_NOMINAL,
    "THESIS_PHYSICAL": THESIS_PHYSICAL,
    "PROTOTYPE": PROTOTYPE,
}


def preset(name: str) -> WheelParams:
    """The preset called `name`.

    Raises:
        ValueError: no preset has that name.
    """
    if name not in PRESETS:
        raise ValueError(f"unknown preset {name!r}: choose from {', '.join(PRESETS)}")
    return PRESETS[name]


def nearest_preset(params: WheelParams) -> WheelParams:
    """The preset from which a machine differs in the fewest fields."""
    return min(PRESETS.values(), key=lambda preset: len(params.differences(preset)))


def machine_name(params: WheelParams) -> str:
    """The preset that a machine is, or the preset that it differs least from, and how."""
    nearest = nearest_preset(params)
    name = next(name for name, preset in PRESETS.items() if preset == nearest)
    different = ", ".join(params.differences(nearest))
    return f"{name} but for {different}" if different else name


#: A machine: a WheelParams, a preset's name, or a mapping of fields that differ from the default's.
Machine: TypeAlias = WheelParams | str | Mapping[str, Any]


def as_params(params: Machine) -> WheelParams:
    """The machine given in any of the forms of `Machine`."""
    if isinstance(params, WheelParams):
        return params
    if isinstance(params, str):
        return preset(params)
    if isinstance(params, Mapping):
        return BUILDABLE.replace(**{str(name): value for name, value in params.items()})
    raise TypeError(
        f"params = {params!r}: give a WheelParams, a preset's name or a dictionary of fields"
    )
