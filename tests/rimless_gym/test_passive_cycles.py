"""A wheel without motor or pendulum on a slope, against the textbook's limit cycle.

From Tedrake, Underactuated Robotics, chapter "Simple legs", with an additional wheel inertia I:
a = pi / n, eta = (I + m l^2 cos 2a) / (I + m l^2). A step multiplies the square of the rate by
eta^2 and adds a constant, so each step reduces the distance from the cycle's square by eta^2.
"""

import math

import numpy as np
import pytest

from rimless_gym import WheelParams, simulate


@pytest.mark.parametrize(("n_legs", "slope"), [(6, 0.25), (8, 0.12), (10, 0.06)])
@pytest.mark.parametrize(("inertia", "start"), [(0.0, 0.9), (0.0, 1.15), (0.05, 1.15)])
def test_a_passive_wheel_converges_to_the_textbook_cycle_at_its_floquet_multiplier(
    n_legs, slope, inertia, start
):
    params = WheelParams(
        n_legs=n_legs,
        slope=slope,
        wheel_inertia=inertia,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )
    a, length, mass = math.pi / n_legs, params.leg_length, params.total_mass
    moment = inertia + mass * length**2
    eta = (inertia + mass * length**2 * math.cos(2 * a)) / moment
    push = 4 * mass * params.gravity * length * math.sin(a) * math.sin(slope) / moment
    cycle = eta * math.sqrt(push / (1 - eta**2))
    if inertia == 0:
        gravity = 4 * params.gravity / length * math.sin(a) * math.sin(slope)
        assert cycle == pytest.approx(math.sqrt(gravity) / math.tan(2 * a), rel=1e-14)

    motion = simulate(params, [params.constants.a, 0, start * cycle, 0], lambda t, x: 0.0, 12.0)
    rates = np.array([event.after[2] for event in motion.touchdowns])
    assert len(rates) > 20
    assert rates[-1] == pytest.approx(cycle, rel=1e-3)
    squares = np.array([start * cycle, *rates]) ** 2
    expected = cycle**2 + (squares[0] - cycle**2) * eta ** (2 * np.arange(len(squares)))
    np.testing.assert_allclose(squares, expected, rtol=1e-11)
