"""What BUILDABLE is made of, and what its assumptions are worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from rimless_gym.hybrid import motor_torque, relative_rate
from scripts.studies.assumptions import (
    GEAR_TORQUE,
    MARKS,
    TIME_CONSTANT,
    TOP_SPEED,
    TOTAL_MASS,
    budget_table,
    chosen,
    machine,
    ripple_loss,
    wheel_parts,
)
from trajopt.gaits.library import shipped, warm_starts

DOCS = Path(__file__).parents[3] / "docs"


def test_the_preset_is_the_machine_of_the_budget_rounded() -> None:
    made = machine(*chosen()).to_dict()
    for name, value in BUILDABLE.to_dict().items():
        if isinstance(value, float):
            assert value == pytest.approx(made[name], rel=0.02), name
        else:
            assert value == made[name], name


def test_the_parts_make_up_the_mass_and_the_pendulum_turns_about_the_hub_as_a_whole() -> None:
    bob, arm = 1.5, 0.2
    made = machine(bob, arm)
    assert made.total_mass == pytest.approx(TOTAL_MASS)
    assert made.wheel_mass > sum(mass for mass, _ in wheel_parts().values())  # payload is left
    about_hub = made.pendulum_inertia + made.pendulum_mass * made.pendulum_length**2
    assert about_hub > bob * arm**2


@pytest.mark.slow
def test_the_presets_gaits_stay_within_what_motor_and_gearhead_endure() -> None:
    whirling = [g for g in shipped(BUILDABLE)[::3] if g.theta_turns == -g.steps]
    assert len(whirling) > 3
    for gait in whirling:
        t = np.linspace(0.0, gait.duration, 400, endpoint=False)
        x, constants = gait.state(t), gait.params.constants
        rate = relative_rate(x[:, 2], x[:, 3], constants)
        assert np.abs(motor_torque(rate, gait.control(t), constants)).max() < GEAR_TORQUE
        assert np.abs(rate).max() * gait.params.gear_ratio < TOP_SPEED


def test_the_page_has_the_budget_of_the_preset_and_a_place_for_the_other_table() -> None:
    page = (DOCS / "machine.md").read_text()
    for name, around in MARKS.items():
        assert around.search(page), name
    assert budget_table() in page


def test_the_ripples_loss_is_that_of_a_current_that_goes_up_and_down_in_straight_lines() -> None:
    gait, frequency = warm_starts(BUILDABLE, 0.6, 1, 1)[0], 20e3
    inductance = TIME_CONSTANT * BUILDABLE.armature_resistance
    parts, squares = (np.arange(1000) + 0.5) / 1000, []
    for volts in abs(gait.control(np.linspace(0.0, gait.duration, 300, endpoint=False))):
        switched = np.where(parts < volts / BUILDABLE.voltage_limit, BUILDABLE.voltage_limit, 0.0)
        squares.append(np.var(np.cumsum(switched - volts) / (1000 * frequency * inductance)))
    lost = BUILDABLE.armature_resistance * np.mean(squares)
    assert ripple_loss(gait, frequency) == pytest.approx(lost, rel=0.02)
