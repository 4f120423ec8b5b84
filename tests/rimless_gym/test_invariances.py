"""Scaling, mirroring or a full turn of the pendulum must turn one motion into another."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, WheelParams
from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import FOOT, MODE, STATE_SIZE, advance

MACHINE = THESIS_PHYSICAL.replace(hub_damping=0.05, drag=0.2, rotor_inertia=1e-7, slope=0.05)
COUNT, INTERVALS = 50, 30


def motions(
    params: WheelParams,
    time: float = 1.0,
    voltage: float = 1.0,
    mirror: bool = False,
    turn: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Final states and summed totals of motions whose times and voltages are scaled."""
    rng, p = np.random.default_rng(8), params.constants
    states = np.zeros((COUNT, STATE_SIZE))
    states[:, 0] = rng.uniform(p.a, p.b, COUNT)
    states[:, 1] = rng.uniform(-math.pi, math.pi, COUNT) + turn
    states[:, 2] = rng.uniform(-2, 3, COUNT) / time
    states[:, 3] = rng.uniform(-6, 6, COUNT) / time
    if mirror:
        states[:, :4] *= -1
        states[:, 0] += math.pi
    total = np.zeros((COUNT, len(ROW)))
    for _ in range(INTERVALS):
        volts = voltage * rng.uniform(-12, 12, COUNT) * (-1 if mirror else 1)
        total += advance(params, states, volts, 0.01 * time, math.inf)
    assert total[:, ROW.touchdowns].sum() > COUNT / 2
    return states, total


@pytest.mark.parametrize("scale", [0.3])
def test_a_larger_machine_moves_the_same_in_time_scaled_by_the_root_of_its_size(
    scale: float,
) -> None:
    # Forces stay the same, so torques and energies grow with size, and rates fall with its root.
    larger = MACHINE.replace(
        leg_length=MACHINE.leg_length * scale,
        pendulum_length=MACHINE.pendulum_length * scale,
        wheel_inertia=MACHINE.wheel_inertia * scale**2,
        pendulum_inertia=MACHINE.pendulum_inertia * scale**2,
        rotor_inertia=MACHINE.rotor_inertia * scale**2,
        armature_resistance=MACHINE.armature_resistance * scale**-1.5,
        hub_damping=MACHINE.hub_damping * scale**1.5,
        drag=MACHINE.drag / scale,
    )
    time = math.sqrt(scale)
    states, total = motions(MACHINE)
    scaled, scaled_total = motions(larger, time, 1 / time)
    assert np.array_equal(states[:, MODE:], scaled[:, MODE:])
    assert np.abs(states[:, :2] - scaled[:, :2]).max() < 1e-8
    assert np.abs(states[:, 2:4] - scaled[:, 2:4] * time).max() < 1e-7
    for energy in (ROW.electrical, ROW.copper, ROW.collision, ROW.drag, ROW.distance):
        assert scaled_total[:, energy] == pytest.approx(scale * total[:, energy], abs=1e-6)


@pytest.mark.parametrize("scale", [7.0])
def test_a_heavier_machine_moves_the_same_with_a_motor_stronger_in_proportion(scale: float) -> None:
    heavier = MACHINE.replace(
        **{
            name: getattr(MACHINE, name) * scale
            for name in (
                *("wheel_mass", "wheel_inertia", "pendulum_mass", "pendulum_inertia"),
                *("rotor_inertia", "hub_damping", "drag"),
            )
        },
        armature_resistance=MACHINE.armature_resistance / scale,
    )
    states, total = motions(MACHINE)
    scaled, scaled_total = motions(heavier)
    assert np.abs(states - scaled).max() < 1e-8
    for energy in (ROW.electrical, ROW.copper, ROW.collision, ROW.drag):
        assert scaled_total[:, energy] == pytest.approx(
            scale * total[:, energy], rel=1e-7, abs=1e-7
        )
    assert scaled_total[:, ROW.friction_demand] == pytest.approx(total[:, ROW.friction_demand])


def test_the_mirror_image_of_a_motion_is_the_motion_of_the_mirror_image() -> None:
    states, total = motions(MACHINE)
    images, image_total = motions(MACHINE.replace(slope=-MACHINE.slope), mirror=True)
    single = states[:, MODE] == SINGLE
    assert np.array_equal(single, images[:, MODE] == SINGLE)
    assert np.abs(states[single, 0] + images[single, 0] - math.pi).max() < 1e-8
    assert np.abs(states[:, [1, 3]] + images[:, [1, 3]]).max() < 1e-7
    assert np.array_equal(states[single, FOOT], -images[single, FOOT])
    assert image_total[:, ROW.electrical] == pytest.approx(total[:, ROW.electrical], abs=1e-7)


def test_a_whole_turn_of_the_pendulum_changes_nothing_but_theta() -> None:
    states, total = motions(MACHINE)
    turned, turned_total = motions(MACHINE, turn=2 * math.pi)
    turned[:, 1] -= 2 * math.pi
    assert np.abs(states - turned).max() < 1e-8
    assert turned_total[:, ROW.electrical] == pytest.approx(total[:, ROW.electrical], abs=1e-7)
