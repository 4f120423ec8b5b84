"""The reference simulator against closed forms, and its argument checks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, Trajectory, hybrid, simulate
from rimless_gym.crossings import first_crossing
from rimless_gym.kernel.stepping import FOOT, advance

P = THESIS_PHYSICAL.constants


@pytest.mark.parametrize(
    ("n_legs", "slope", "inertia", "start"), [(6, 0.25, 0.0, 0.9), (8, 0.12, 0.05, 1.15)]
)
def test_a_passive_wheel_converges_to_the_textbook_cycle_at_its_floquet_multiplier(
    n_legs: int, slope: float, inertia: float, start: float
) -> None:
    """A wheel without motor or pendulum: Tedrake, Underactuated Robotics, "Simple legs".

    With an additional wheel inertia I, a = pi / n, eta = (I + m l^2 cos 2a) / (I + m l^2): a step
    multiplies the square of the rate by eta^2 and adds a constant.
    """
    params = THESIS_PHYSICAL.replace(
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

    motion = simulate(params, [params.constants.a, 0, start * cycle, 0], lambda t, x: 0.0, 4.0)
    rates = np.array([event.after[2] for event in motion.touchdowns])
    assert len(rates) > 5
    squares = np.array([start * cycle, *rates]) ** 2
    expected = cycle**2 + (squares[0] - cycle**2) * eta ** (2 * np.arange(len(squares)))
    np.testing.assert_allclose(squares, expected, rtol=1e-11)


def test_energy_is_constant_between_touchdowns_of_an_unpowered_frictionless_wheel() -> None:
    params = THESIS_PHYSICAL.replace(motor_constant=0.0)
    motion = simulate(params, [1.2, 1.0, 1.5, -2.0], lambda t, x: 0.0, 1.0)
    assert motion.touchdowns
    loss = sum(event.loss for event in motion.touchdowns)
    assert motion.ledger.collision == pytest.approx(loss, abs=1e-12)
    assert motion.ledger.mechanical_change == pytest.approx(-loss, abs=1e-10)
    assert all(event.loss > 0 for event in motion.touchdowns)


def test_states_are_right_continuous_at_touchdowns() -> None:
    motion = simulate(THESIS_PHYSICAL, [1.5, 0.0, 2.0, 0.0], lambda t, x: 0.0, 1.0)
    event = motion.touchdowns[0]
    assert motion.state(event.time) == pytest.approx(event.after, abs=1e-10)
    assert motion.state(event.time, side="left") == pytest.approx(event.before, abs=1e-10)
    assert event.before[0] == P.b
    assert event.after[0] == P.a
    assert motion.state([0.0, event.time]).shape == (2, 4)


def test_sampled_voltages_are_held_for_ten_milliseconds() -> None:
    volts = np.array([3.0, -5.0, 8.0])
    held = simulate(THESIS_PHYSICAL, [1.5, 0.0, 1.0, 0.0], volts, 0.03)
    knots = (0.01, 0.02)
    stepped = simulate(
        THESIS_PHYSICAL,
        [1.5, 0.0, 1.0, 0.0],
        lambda t, x: float(volts[np.searchsorted(knots, t, side="right")]),
        0.03,
        breakpoints=knots,
    )
    assert held.x[-1] == pytest.approx(stepped.x[-1], abs=1e-14)
    assert set(held.u) == set(volts)


def test_work_that_changes_sign_is_split_where_it_does() -> None:
    """Work over a braked start in which psi' changes sign, against the start cut at that time.

    If |T psi'| is integrated instead, every start is off by about 1e-13 J, some by 1e-11, and one
    in thousands by 1e-7, because the integrator's error estimate misses the kink altogether.
    """
    rng, p, T = np.random.default_rng(0), PROTOTYPE.constants, 0.012
    for _ in range(12):
        u, lean, dphi, dpsi = rng.uniform([-8, -1, 0.5, 1], [-2, 1, 2, 4])
        start = [1.5, lean, dphi, dpsi - p.d1 * dphi]
        whole = simulate(PROTOTYPE, start, lambda t, x, u=u: u, T)
        turn = brentq(lambda t, m=whole: hybrid.relative_rate(*m.state(t)[2:], p), 0, T, xtol=1e-15)
        cut = simulate(PROTOTYPE, start, lambda t, x, u=u: u, T, breakpoints=[turn])
        assert whole.ledger.shaft == pytest.approx(cut.ledger.shaft, abs=3e-14)
        assert whole.ledger.electrical_positive == pytest.approx(
            cut.ledger.electrical_positive, abs=3e-14
        )


def test_losing_contact_ends_the_motion_only_if_the_foot_cannot_be_pulled() -> None:
    start = [math.pi / 2, math.pi, 6.0, 0.0]  # fast enough over the top to fly
    free = simulate(THESIS_PHYSICAL, start, lambda t, x: 0.0, 0.05, pull=0.0)
    pinned = simulate(THESIS_PHYSICAL, start, lambda t, x: 0.0, 0.05)
    assert free.failure == "contact_lost"
    assert free.t[-1] < 0.05
    assert pinned.failure is None
    assert pinned.min_normal_force < 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x0": [1.5, math.nan, 0, 0]}, "finite"),
        ({"x0": [1.5, 0, 0, 100.0]}, "60"),
        ({"control": np.zeros(3)}, "more samples"),
        ({"control": lambda t, x: math.nan}, "control.*finite voltage"),
        ({"mode": "double_stance"}, "double stance has phi"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments: dict, message: str) -> None:
    good = {"x0": [1.5, 0.0, 0.0, 0.0], "control": np.zeros(10), "duration": 0.1}
    with pytest.raises(ValueError, match=message):
        simulate(THESIS_PHYSICAL, **(good | arguments))


def test_slip_is_reported_for_forces_and_for_impulses() -> None:
    def motion(friction: float) -> Trajectory:
        params = THESIS_PHYSICAL.replace(friction=friction)
        return simulate(params, [1.5, 0.0, 2.0, 0.0], lambda t, x: 0.0, 0.6)

    walk = motion(1.0)
    assert walk.touchdowns
    jx, jy = walk.touchdowns[0].impulse
    assert walk.impulse_friction_demand >= abs(jx) / jy > 0
    demand = max(walk.friction_demand, walk.impulse_friction_demand)
    assert motion(demand + 0.01).slips is False
    assert motion(demand - 0.01).slips is True


def test_a_lift_off_at_the_start_moves_the_foot_as_in_the_kernel() -> None:
    params = THESIS_PHYSICAL
    found = set()
    for theta in np.linspace(-2.0, 2.0, 9):
        for volts in (-15.0, 15.0):
            motion = simulate(
                params, [P.a, theta, 0.0, 0.0], [volts], 0.01, mode="double_stance", pull=math.inf
            )
            state = np.array([[P.a, theta, 0.0, 0.0, 1.0, 0.0]])
            advance(params, state, np.array([volts]), pull=math.inf)
            assert motion.steps == state[0, FOOT]
            found.add(motion.steps)
    assert found == {0, -1}


def test_the_first_of_three_crossings_between_two_samples_is_found() -> None:
    def guards(t: float, y: np.ndarray) -> tuple[float, ...]:
        return (float((t - 0.51) * (t - 0.55) * (t - 0.56)),)

    found = first_crossing(guards, lambda t: np.array([t]), 0.0, 1.0)
    assert found is not None
    assert found[1] == pytest.approx(0.51, abs=1e-12)
