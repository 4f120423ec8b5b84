"""Lower bounds on the cost of transport."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL, simulate
from rimless_gym.equations import equations
from trajopt.gaits.bounds import cot_bound, least_losses, motor_deficit
from trajopt.gaits.library import index
from trajopt.gaits.problem import MIN_NORMAL_FORCE, fastest_pressed

LOSSY = BUILDABLE.replace(hub_damping=0.01, drag=0.2, pendulum_drag=1e-4, friction_width=2.0)


def test_no_shipped_gait_is_below_its_bound_and_the_best_is_within_a_percent_of_it() -> None:
    above = [
        entry.cot
        / cot_bound(
            entry.params, speed=entry.speed, steps=entry.steps, theta_turns=entry.theta_turns
        )
        - 1
        for entry in index()
        if entry.params == BUILDABLE
    ]
    assert 0 < min(above) < 0.01


def test_physics_refuses_no_gait_that_is_shipped() -> None:
    for entry in index():
        turns = entry.theta_turns / entry.steps
        assert motor_deficit(entry.params, entry.speed, turns) <= 0
        assert entry.speed < fastest_pressed(entry.params)


def test_no_step_with_pressed_feet_is_faster_than_the_fastest_possible() -> None:
    wheel = BUILDABLE.replace(pendulum_length=0.01, motor_constant=0.0)
    pressed = []
    for rate in np.linspace(1.5, 12.0, 8):
        run = simulate(wheel, [wheel.constants.a, 0.0, rate, 0.0], lambda t, x: 0.0, 1.0)
        if run.touchdowns:
            time = run.touchdowns[0].time
            step = simulate(wheel, run.x[0], lambda t, x: 0.0, 0.999 * time)
            if step.min_normal_force >= MIN_NORMAL_FORCE * wheel.weight:
                pressed.append(wheel.step_length / time)
    assert 0.5 * fastest_pressed(wheel) < max(pressed) <= fastest_pressed(wheel)


def test_no_distribution_of_rates_and_voltages_gives_more_power_than_the_motor_can() -> None:
    eq, c, rng = equations(np.sin, np.cos, sqrt=np.sqrt), LOSSY.constants, np.random.default_rng(0)
    for scale in 10.0 ** rng.uniform(-2, 2, 200):
        dpsi = rng.normal(rng.normal(), 1, 50) * scale
        volts = LOSSY.voltage_limit * np.sign(dpsi) * rng.uniform(0, 1, 50) ** 0.1
        speed = 0.5
        turns = (dpsi.mean() * c.chord / speed - c.alpha) / (2 * math.pi)
        given = np.mean(eq.shaft_power(dpsi, volts, c))
        resting = least_losses(LOSSY, speed, -c.alpha / (2 * math.pi))  # psi' = 0
        braking = np.mean(eq.viscous_friction(dpsi, c) * dpsi + c.F0 * eq.slide(dpsi, c) * dpsi)
        assert given - braking <= resting - motor_deficit(LOSSY, speed, turns) + 1e-9


def test_a_motor_that_cannot_overcome_friction_is_refused() -> None:
    stalled = BUILDABLE.replace(hub_friction=5.0)
    assert all(motor_deficit(stalled, 0.5, turns) > 0 for turns in (-1, 0))


def test_no_distribution_of_rates_loses_less_than_the_bound() -> None:
    eq, c, rng = equations(np.sin, np.cos, sqrt=np.sqrt), LOSSY.constants, np.random.default_rng(0)
    for scale in 10.0 ** rng.uniform(-2, 2, 200):
        dphi, dpsi = rng.normal(rng.normal(), 1, (2, 50)) * scale
        coasting = eq.motor_voltage(dpsi, 0.0, c)
        lost = sum(np.mean(loss) for loss in eq.losses(dphi, dpsi, 0.0, coasting, c))
        speed = dphi.mean() / c.alpha * c.chord
        turns = (dpsi.mean() / dphi.mean() - 1) * c.alpha / (2 * math.pi)
        assert lost >= least_losses(LOSSY, speed, turns) * (1 - 1e-12)


def test_the_bound_counts_idle_power_slopes_and_copper() -> None:
    gait = {"speed": 0.6, "steps": 2, "theta_turns": -2}
    level = cot_bound(BUILDABLE, **gait)
    assert cot_bound(BUILDABLE.replace(idle_power=0.0), **gait) < level
    climb = cot_bound(BUILDABLE.replace(slope=-0.05), **gait)
    assert climb > level + math.sin(0.05)  # the copper loss grows with the power
    downhill = BUILDABLE.replace(slope=0.05)
    assert cot_bound(downhill, **gait) == pytest.approx(0.5 / (BUILDABLE.weight * 0.6))
    assert cot_bound(downhill, **gait, regeneration=True) < 0
    weak = BUILDABLE.replace(slope=-1.5, armature_resistance=50.0)
    assert cot_bound(weak, **gait) == math.inf
    assert cot_bound(THESIS_PHYSICAL, **gait) == 0
