"""Lower bounds on the cost of transport."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from rimless_gym.equations import equations
from trajopt.gaits.bounds import cot_bound, least_losses
from trajopt.gaits.library import index

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
