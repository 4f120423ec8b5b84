"""The equations, compiled and as CasADi traces them: what must hold for any machine."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rimless_gym import hybrid
from rimless_gym.equations import equations
from rimless_gym.params import WheelParams
from rimless_gym.presets import PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL
from rimless_gym.symbolic import HybridModel

number = equations(math.sin, math.cos)


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


machines = st.builds(
    THESIS_PHYSICAL.replace,
    wheel_mass=between(0.1, 3),
    wheel_inertia=between(0.0, 2),
    leg_length=between(0.2, 1.5),
    n_legs=st.integers(3, 12),
    pendulum_mass=between(0.1, 3),
    pendulum_inertia=between(0.01, 2),
    pendulum_length=between(0.0, 1),
    gear_ratio=between(1, 600),
    rotor_inertia=between(0.0, 1e-5),
    hub_damping=between(0.0, 2),
    hub_friction=between(0.01, 2),
    gear_loss=between(0.0, 0.9),
    drag=between(0.0, 2),
    slope=between(-0.4, 0.4),
    motor_mount=st.sampled_from(["wheel", "frame"]),
)
rates = between(-12, 12)
angles = between(-7, 7)


def random_states(params: WheelParams, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    p = params.constants
    x = rng.uniform([p.a, -7, -6, -12], [p.b, 7, 6, 12], (count, 4)).T
    return x, rng.uniform(-20, 20, (1, count))


LOSSY = PROTOTYPE.replace(
    drag=0.7,
    pendulum_drag=0.01,
    hub_damping=0.3,
    hub_friction=0.2,
    gear_loss=0.3,
    rotor_inertia=3e-7,
    slope=-0.2,
    pendulum_reach=0.11,
)
MACHINES = [
    THESIS_PHYSICAL,
    THESIS_NOMINAL.replace(motor_mount="frame", slope=0.1),
    LOSSY,
    LOSSY.replace(motor_mount="frame"),
]


@pytest.fixture(params=MACHINES, ids=["physical", "nominal-frame", "lossy", "lossy-frame"])
def params(request):
    return request.param


@pytest.mark.parametrize("mode", ["single_stance", "double_stance"])
def test_mechanical_energy_changes_by_electrical_power_less_losses(params, mode):
    model = HybridModel(params)
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    grows = ca.jtimes(model.mechanical_energy(x), x, model.flow(x, u, mode))
    name = "losses" if mode == "single_stance" else "losses_double_stance"
    lost = ca.sum1(model.functions[name](x, u))
    drawn = model.electrical_power(x, u)
    balance = ca.Function("f", [x, u], [grows - (drawn - lost), drawn])
    states, voltages = random_states(params, 1000)
    if mode == "double_stance":
        states[0], states[2] = params.constants.a, 0.0
    residual, power = (np.asarray(value) for value in balance(states, voltages))
    assert np.max(np.abs(residual) / (1 + np.abs(power))) < 1e-10


def test_momentum_changes_by_ground_reaction_gravity_and_drag(params):
    model = HybridModel(params)
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    change = ca.jtimes(model.functions["linear_momentum"](x), x, model.flow(x, u))
    weight = params.weight * ca.vertcat(math.sin(params.slope), -math.cos(params.slope))
    velocity = ca.jtimes(model.functions["hub_position"](x), x, model.flow(x, u))
    drag = -params.drag * ca.norm_2(velocity) * velocity
    residual = ca.Function("f", [x, u], [change - weight - drag - model.ground_reaction(x, u)])
    assert np.max(np.abs(np.asarray(residual(*random_states(params, 1000))))) < 1e-8


@settings(max_examples=100)
@given(machines, angles, rates, rates, st.sampled_from([1, -1]))
def test_plastic_touchdown_never_creates_energy(params, theta, dphi, dtheta, direction):
    p = params.constants
    old, new = (p.b, p.a) if direction > 0 else (p.a, p.b)
    before = number.kinetic_energy(old, theta, dphi, dtheta, p)
    after = number.kinetic_energy(new, theta, *number.impact(new, old, theta, dphi, dtheta, p), p)
    rest = number.stop_on_two_feet(old, theta, dphi, dtheta, p)
    standing = number.kinetic_energy(new, theta, 0.0, rest, p)
    rounding = 1e-12 * before + 1e-300
    assert standing - rounding <= after <= before + rounding


@settings(max_examples=100)
@given(machines, angles, rates, rates)
def test_relabelled_touchdown_changes_the_energy_by_its_formula(params, theta, dphi, dtheta):
    p = params.replace(impact_law="relabel").constants
    assert number.impact(p.a, p.b, theta, dphi, dtheta, p) == (dphi, dtheta)
    before = number.kinetic_energy(p.b, theta, dphi, dtheta, p)
    after = number.kinetic_energy(p.a, theta, dphi, dtheta, p)
    step = p.Je3 * (math.sin(p.a + theta) - math.sin(p.b + theta)) * dphi * dtheta
    assert after - before == pytest.approx(step, rel=1e-9, abs=1e-9 * (1 + before))


@settings(max_examples=50)
@given(machines, angles, rates, rates)
def test_thesis_touchdown_solves_the_printed_equations(params, theta, dphi, dtheta):
    """Equations (3.67) to (3.70) with the shorthand written out, solved as a system."""
    m1, m2, i1, i2 = (
        *(params.wheel_mass, params.pendulum_mass),
        *(params.wheel_inertia, params.pendulum_inertia),
    )
    l1, l2, p = params.leg_length, params.pendulum_length, params.constants
    new, old = math.sin(p.a + theta), math.sin(p.b + theta)
    left = np.array(
        [
            [l1 * l2 * m2 * new, m2 * l2**2 + i2],
            [l1 * l2 * m2 * new - l1**2 * (m1 + m2) - 2 * i1, i2 + l2**2 * m2 * (new - 1)],
        ]
    )
    right = [
        l1 * l2 * m2 * old * dphi + (m2 * l2**2 + i2) * dtheta,
        (l1 * l2 * m2 * old - i1) * dphi
        + (l1 * l2 * m2 * math.cos(p.b + theta) + i2 + l2**2 * m2) * dtheta,
    ]
    assume(np.linalg.cond(left) < 1e6)
    printed = params.replace(impact_law="thesis", rotor_inertia=0.0).constants
    ours = number.impact(p.a, p.b, theta, dphi, dtheta, printed)
    assert ours == pytest.approx(np.linalg.solve(left, right), rel=1e-8, abs=1e-8)


def test_motor_pole_is_the_fastest_decay_of_the_relative_rate(params):
    """But for dry friction and air drag, which have rates of their own."""
    params = params.replace(drag=0.0, hub_friction=0.0, gear_loss=0.0)
    model = HybridModel(params)
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    damping = ca.jacobian(model.flow(x, u)[2:], x[2:])
    function = ca.Function("f", [x, u], [-ca.trace(damping)])
    poses = np.zeros((4, 721))
    poses[0], poses[1] = math.pi / 2, np.linspace(-math.pi, math.pi, 721)
    assert params.motor_pole == pytest.approx(np.asarray(function(poses, 0)).max(), rel=1e-3)


def test_compiled_and_traced_functions_agree_to_rounding(params):
    model, p = HybridModel(params), params.constants
    x, u = random_states(params, 100)
    traced = {
        "flow": np.asarray(model.flow(x, u))[2:],
        "standing": np.asarray(model.flow(x, u, "double_stance"))[3:],
        "reaction": np.asarray(model.ground_reaction(x, u)),
        "energy": np.asarray(model.mechanical_energy(x)),
        "losses": np.asarray(model.functions["losses"](x, u)),
        "touchdown": np.asarray(model.touchdown(x))[2:],
    }
    compiled: dict[str, list] = {name: [] for name in traced}
    for state, volt in zip(x.T, u[0], strict=True):
        phi, theta, dphi, dtheta = (float(value) for value in state)
        accelerations = hybrid.single_stance(*state, volt, p)
        rate = hybrid.relative_rate(dphi, dtheta, p)
        compiled["flow"].append(accelerations)
        compiled["standing"].append((hybrid.double_stance(p.a, theta, 0.0, dtheta, volt, p),))
        compiled["reaction"].append(hybrid.ground_reaction(*state, *accelerations, p))
        compiled["energy"].append((hybrid.mechanical_energy(*state, p),))
        change = hybrid.relative_rate(*accelerations, p)
        compiled["losses"].append(hybrid.losses(dphi, rate, change, volt, p))
        compiled["touchdown"].append(hybrid.impact(phi - p.alpha, phi, theta, dphi, dtheta, p))
    for name, values in compiled.items():
        scale = 1 + np.abs(traced[name]).max()
        np.testing.assert_allclose(np.array(values).T / scale, traced[name] / scale, atol=1e-13)


def test_touchdown_relabels_the_leg_and_keeps_the_pendulums_angle(params):
    p = params.constants
    after = np.asarray(HybridModel(params).touchdown([p.b, 0.4, 1.2, -0.3])).ravel()
    assert after[:2] == pytest.approx((p.a, 0.4), rel=1e-15)


def test_a_wheel_without_pendulum_loses_the_textbook_share_of_its_rate():
    for n_legs, inertia in ((5, 0.0), (5, 0.3), (8, 0.1)):
        wheel = THESIS_PHYSICAL.replace(
            n_legs=n_legs, wheel_inertia=inertia, pendulum_length=0.0, pendulum_inertia=0.1
        )
        p, moment = wheel.constants, wheel.total_mass * wheel.leg_length**2
        eta = (inertia + moment * math.cos(2 * math.pi / n_legs)) / (inertia + moment)
        rates = number.impact(p.a, p.b, 0.3, 1.7, -0.4, p)
        assert rates == pytest.approx((eta * 1.7, -0.4), rel=1e-14)


def test_the_wheels_rate_after_touchdown_does_not_depend_on_the_pendulums():
    p = THESIS_PHYSICAL.constants
    rates = [
        [number.impact(p.a, p.b, theta, 1.0, dtheta, p)[0] for dtheta in (-8.0, 0.0, 5.0)]
        for theta in np.linspace(-math.pi, math.pi, 721)
    ]
    assert np.ptp(rates, axis=1).max() < 1e-12
    assert (round(np.min(rates), 2), round(np.max(rates), 2)) == (0.21, 0.69)
