"""Machines with names, and the forms in which users may give a machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from rimless_gym.params import WheelParams

#: Thesis, Table 4.1 with the motor of Table 4.2.
THESIS_NOMINAL = WheelParams(
    wheel_mass=1.0,
    wheel_inertia=1.0,
    leg_length=1.0,
    pendulum_mass=1.0,
    pendulum_inertia=1.0,
    pendulum_length=0.5,
)

#: Thesis, Table 4.6.
THESIS_PHYSICAL = WheelParams()

#: The machine as built: pendulum mass and length a quarter of Table 4.6's.
PROTOTYPE = WheelParams(
    pendulum_mass=0.555, pendulum_inertia=0.555 * 0.085**2 / 3, pendulum_length=0.085
)

#: A machine that can be built from catalogue parts, the environment's default; docs/machine.md has
#: sources and budget.
BUILDABLE = WheelParams(
    wheel_mass=1.39,
    wheel_inertia=0.0246,
    leg_length=0.3,
    n_legs=7,
    pendulum_mass=1.61,
    pendulum_inertia=0.0014,
    pendulum_length=0.142,
    pendulum_reach=0.167,
    motor_constant=0.0229,
    gear_ratio=20.95,
    armature_resistance=1.9,
    rotor_inertia=9.6e-7,
    hub_friction=0.0212,
    gear_loss=0.07,
    idle_power=0.5,
    friction=0.8,
    voltage_limit=12.0,
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


def machine_name(params: WheelParams) -> str:
    """The preset that a machine is, or the preset that it differs least from, and how."""
    name, nearest = min(PRESETS.items(), key=lambda item: len(params.differences(item[1])))
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
