"""Which machines are valid, and the errors for those that are not."""

import contextlib
import dataclasses
import json
import math
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rimless_gym.kernel.stepping import require_steppable
from rimless_gym.params import WheelParams, shorthand
from rimless_gym.presets import (
    BUILDABLE,
    PRESETS,
    PROTOTYPE,
    THESIS_NOMINAL,
    THESIS_PHYSICAL,
    as_params,
    machine_name,
    preset,
)
from rimless_gym.reference import simulate
from rimless_gym.symbolic import HybridModel

POSITIVE = (
    *("leg_length", "gear_ratio", "armature_resistance", "friction_width"),
    *("gravity", "voltage_limit"),
)
NOT_NEGATIVE = (
    *("wheel_mass", "wheel_inertia", "pendulum_mass", "pendulum_inertia", "pendulum_length"),
    *("motor_constant", "rotor_inertia", "hub_damping", "drag", "idle_power", "friction"),
    "pendulum_drag",
    *("pendulum_reach", "hub_friction", "gear_loss"),
)
NUMBERS = [f.name for f in dataclasses.fields(WheelParams) if f.name[:5] not in ("motor", "impac")]


def test_presets_are_those_of_the_thesis():
    assert (THESIS_NOMINAL.leg_length, THESIS_NOMINAL.pendulum_length) == (1.0, 0.5)
    assert (THESIS_PHYSICAL.wheel_mass, THESIS_PHYSICAL.wheel_inertia) == (1.4, 0.092)
    assert THESIS_PHYSICAL.pendulum_inertia == pytest.approx(2.22 * 0.34**2 / 3, rel=1e-15)
    assert PROTOTYPE.pendulum_mass == pytest.approx(THESIS_PHYSICAL.pendulum_mass / 4)
    assert PROTOTYPE.pendulum_length == pytest.approx(THESIS_PHYSICAL.pendulum_length / 4)
    assert WheelParams() == BUILDABLE == as_params({})
    for machine in (THESIS_NOMINAL, THESIS_PHYSICAL, PROTOTYPE):
        assert (machine.n_legs, machine.voltage_limit, machine.friction) == (5, 20.0, 1.0)
        assert (machine.motor_mount, machine.impact_law) == ("wheel", "plastic")
        losses = (machine.rotor_inertia, machine.hub_damping, machine.hub_friction)
        losses += (machine.gear_loss, machine.drag, machine.idle_power)
        assert losses == (0.0,) * 6


def test_the_default_machine_can_be_built():
    """It has the losses of a real drive, and its pendulum clears the floor in every pose."""
    assert as_params({}) == BUILDABLE
    for name in ("rotor_inertia", "hub_friction", "gear_loss", "idle_power"):
        assert getattr(BUILDABLE, name) > 0
    assert BUILDABLE.pendulum_length < BUILDABLE.constants.reach
    hub = BUILDABLE.leg_length * math.cos(BUILDABLE.leg_angle / 2)  # its lowest, on two feet
    assert hub - BUILDABLE.constants.reach >= 0.01


def test_every_number_must_be_a_real_number_within_its_range() -> None:
    for name in NUMBERS:
        for value in ("1", True, 1j, np.ones(2)):
            with pytest.raises(TypeError, match=rf"{name} = .*: must be a real number"):
                THESIS_PHYSICAL.replace(**{name: value})
        for value in (math.nan, math.inf, -math.inf, 1e300, -1e31, 10**400):
            with pytest.raises(ValueError, match=rf"{name} = .*: must be finite, and at most 1e"):
                THESIS_PHYSICAL.replace(**{name: value})
    for name in POSITIVE:
        for value in (0, -0.5, 1e-300):
            with pytest.raises(ValueError, match=rf"{name} = .*: must be greater than 0"):
                THESIS_PHYSICAL.replace(**{name: value})
    for name in NOT_NEGATIVE:
        with pytest.raises(ValueError, match=rf"{name} = -0.5: must be at least 0"):
            THESIS_PHYSICAL.replace(**{name: -0.5})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n_legs": 2}, r"n_legs = 2: must be an integer of at least 3"),
        ({"n_legs": 5.5}, r"n_legs = 5.5: must be an integer of at least 3"),
        ({"slope": math.pi / 2}, r"slope = 1\.57.*: must lie strictly between -pi/2 and pi/2"),
        ({"motor_mount": "leg"}, r"motor_mount = 'leg': choose from .*wheel.*frame"),
        ({"impact_law": "rubber"}, r"impact_law = 'rubber': choose from .*plastic.*relabel"),
        ({"gear_loss": 1.0, "hub_friction": 1.0}, r"gear_loss = 1.0: must be less than 1"),
        ({"gear_loss": 0.1}, r"hub_friction = 0.0: must be greater than 0 with gear_loss = 0.1"),
        ({"wheel_mass": 0, "pendulum_mass": 0}, r"wheel_mass \+ pendulum_mass = 0: one of them"),
        ({"pendulum_reach": 0.1}, r"pendulum_reach = 0.1: must be at least pendulum_length"),
        ({"pendulum_inertia": 0, "pendulum_length": 0}, r"singular.*pendulum_inertia > 0"),
        ({"rotor_inertia": 1e20}, r"singular.*lower rotor_inertia .* 2.56e\+25 kg m"),
        (
            {"wheel_mass": 0, "wheel_inertia": 0, "pendulum_inertia": 0},
            r"singular.*wheel_mass or wheel_inertia > 0",
        ),
        ({"leg_lenght": 1}, r"'leg_lenght' is not a field of WheelParams: choose from.*leg_length"),
    ],
)
def test_errors_name_the_value_the_limit_and_the_remedy(change, message):
    with pytest.raises(ValueError, match=message):
        THESIS_PHYSICAL.replace(**change)


@pytest.mark.parametrize(
    ("change", "stale"),
    [
        ({"pendulum_mass": 1.8}, "pendulum_inertia = 0.0014: as"),
        ({"pendulum_length": 0.1}, "pendulum_inertia = 0.0014 and pendulum_reach = 0.167: as"),
        ({"pendulum_length": 0.1, "pendulum_inertia": 0.0014}, "pendulum_reach = 0.167: as"),
    ],
)
def test_what_follows_from_a_pendulums_shape_is_not_left_behind_unnoticed(change, stale):
    with pytest.warns(UserWarning, match=stale):
        as_params(change)
    with warnings.catch_warnings(action="error"):
        as_params({"pendulum_inertia": 0.002, "pendulum_reach": 0.2} | change)
        as_params({"n_legs": 8, "pendulum_mass": BUILDABLE.pendulum_mass})


SIZES = st.sampled_from([0.0, 5e-324, 1e-200, 1e-30, 1e-12, 1.0, 1e12, 1e30])


@given(st.dictionaries(st.sampled_from([*POSITIVE, *NOT_NEGATIVE]), SIZES))
def test_everything_derived_from_a_valid_machine_is_finite(fields):
    try:
        machine = WheelParams(**fields)
    except ValueError:
        return
    assert all(math.isfinite(value) for value in machine.constants)
    assert math.isfinite(machine.motor_pole)
    assert machine.weight > 0
    with contextlib.suppress(ValueError):
        require_steppable(machine)


def test_machines_of_any_mass_and_the_limiting_cases_of_the_textbook_are_accepted():
    names = ("wheel_mass", "wheel_inertia", "pendulum_mass", "pendulum_inertia")
    for scale in (1e-6, 1e6):
        scaled = {name: scale * getattr(THESIS_PHYSICAL, name) for name in names}
        assert THESIS_PHYSICAL.replace(**scaled).weight == pytest.approx(scale * 3.62 * 9.81)
    zero = ("pendulum_length", "wheel_inertia", "motor_constant", "pendulum_inertia", "wheel_mass")
    for limit in (*({name: 0} for name in zero), {"n_legs": 3}, {"friction": 0}):
        assert THESIS_PHYSICAL.replace(**limit) != THESIS_PHYSICAL


def test_machines_are_immutable_values_of_plain_numbers():
    copy = WheelParams(**THESIS_PHYSICAL.to_dict())
    assert (copy, hash(copy)) == (THESIS_PHYSICAL, hash(THESIS_PHYSICAL))
    with pytest.raises(dataclasses.FrozenInstanceError):
        copy.slope = 0.3
    steep = THESIS_PHYSICAL.replace(slope=0.1)
    assert (steep.slope, THESIS_PHYSICAL.slope) == (0.1, 0.0)
    assert steep.replace(slope=0.0) == THESIS_PHYSICAL
    machine = WheelParams(wheel_mass=np.float32(2), n_legs=np.int64(6), slope=0)
    numbers = machine.wheel_mass, machine.n_legs, machine.slope
    assert [type(number) for number in numbers] == [float, int, float]
    for machine in PRESETS.values():
        assert WheelParams(**json.loads(json.dumps(machine.to_dict()))) == machine
    with pytest.raises(ValueError, match="read-only"):
        copy.constants_array[0] = 1.0
    assert copy.constants_array.tolist() == list(THESIS_PHYSICAL.constants)


@given(st.integers(3, 40), st.floats(0.05, 3.0))
def test_geometry_of_a_step(n_legs, leg_length):
    machine = THESIS_PHYSICAL.replace(n_legs=n_legs, leg_length=leg_length)
    p = shorthand(machine)
    assert p.b - p.a == pytest.approx(machine.leg_angle, rel=1e-12)
    assert p.a + p.b == pytest.approx(math.pi, rel=1e-15)
    between_feet = leg_length * (math.cos(p.a) - math.cos(p.b))
    assert machine.step_length == pytest.approx(between_feet, rel=1e-12)
    assert machine.weight == pytest.approx(3.62 * 9.81, rel=1e-12)


def test_a_machine_may_be_given_by_name_or_fields_to_every_tool() -> None:
    start = [1.5, 0.0, 2.0, 0.0]
    for name, machine in PRESETS.items():
        assert preset(name) is as_params(name) is machine
    fields = {"drag": 0.1}
    for form, machine in (("PROTOTYPE", PROTOTYPE), (fields, BUILDABLE.replace(drag=0.1))):
        assert as_params(form) == as_params(machine) == machine
        assert HybridModel(form).params == machine
        assert simulate(form, start, [1.0], 0.01).params == machine
    assert machine_name(PROTOTYPE) == "PROTOTYPE"
    assert machine_name(BUILDABLE.replace(drag=0.1)) == "BUILDABLE but for drag"
