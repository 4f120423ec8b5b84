"""The study of landings: what it imposes, and the closed form of its page."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from rimless_gym.equations import equations
from scripts.studies.collisionless import with_landing, without_deceleration
from trajopt.gaits.problem import gait_problem

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


def test_the_closed_form_balances_the_wheel_at_its_guard() -> None:
    c = BUILDABLE.replace(hub_friction=0.0, gear_loss=0.0).constants
    theta, dtheta = np.random.default_rng(0).uniform([-3, -12], [3, 12], (50, 2)).T
    pushed = c.Je3 * np.cos(c.b + theta) * dtheta**2 - c.S1 * c.gy * math.sin(c.alpha / 2)
    lag = c.Je2 - c.Je3 * np.sin(c.b + theta)
    ddtheta = (pushed - c.S2 * c.gy * np.sin(theta)) / lag
    torque = (c.Je2 + c.Jr) * ddtheta + c.S2 * c.gy * np.sin(theta)
    volts = _eq.motor_voltage(dtheta, torque / c.K, c)
    accelerations = _eq.single_stance(c.b, theta, 0.0, dtheta, volts, c)
    assert np.abs(accelerations[0]).max() < 1e-9 * np.abs(accelerations[1]).max()


def test_a_landing_is_imposed_and_softer_ones_may_stay_slow() -> None:
    problem = gait_problem(BUILDABLE, speed=0.6, steps=1, theta_turns=-1)
    for rate in (0.5, 0.005):
        (stance,) = with_landing(problem, rate).phases
        assert stance.end["phi'"] == rate
        assert stance.at_end is not None
        assert 0 < stance.at_end.lower[-1] < rate
    (gentle,) = without_deceleration(problem, BUILDABLE).phases
    b, at_rest = BUILDABLE.constants.b, [BUILDABLE.constants.b, 0.0, 0.0, 0.0]
    assert gentle.path is not None
    bounded = float(gentle.path.function(at_rest, [0.0], [])[-1])
    assert bounded == pytest.approx(_eq.single_stance(b, 0, 0, 0, 0, BUILDABLE.constants)[0])
