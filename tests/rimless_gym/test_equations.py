"""The equations against a second, independent derivation.

The second model is a floating base: the hub can be anywhere, q = (x, y, phi, theta). Automatic
differentiation of the positions of the two masses in Cartesian coordinates gives its inertia and
bias forces. Feet are constraints with multipliers. One linear system,

    | M  -J' | |   a    |   |    Q - h     |
    | J   0  | | lambda | = |  -(dJ/dt) v  |

then gives accelerations and ground reactions; with momenta on its right-hand side, it gives the
touchdown.
"""

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from rimless_gym.equations import equations
from rimless_gym.params import WheelParams, shorthand
from rimless_gym.presets import THESIS_PHYSICAL

NAMES = (
    *("wheel_mass", "wheel_inertia", "leg_length", "pendulum_mass", "pendulum_inertia"),
    *("pendulum_length", "motor_constant", "gear_ratio", "armature_resistance", "rotor_inertia"),
    *("hub_damping", "drag", "gravity", "slope"),
)
LOW = np.array([0.1, 0.01, 0.2, 0.1, 0.01, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0, -0.5])
HIGH = np.array([3.0, 2.0, 1.5, 3.0, 2.0, 1.0, 0.01, 500, 9.0, 1e-5, 2.0, 2.0, 20, 0.5])
N_SAMPLES = 2000

eq = equations(ca.sin, ca.cos, sqrt=ca.sqrt)
eq_numbers = equations(math.sin, math.cos)


class Case:
    """Random machines and states, and the symbols that stand for them, for one motor mount."""

    def __init__(self, mount: str, n_legs: int = 5) -> None:
        rng = np.random.default_rng(n_legs)
        self.values = rng.uniform(LOW, HIGH, (N_SAMPLES, len(NAMES))).T
        alpha = 2 * math.pi / n_legs
        a, b = (math.pi - alpha) / 2, (math.pi + alpha) / 2
        span = np.array([[a, b], [-7, 7], [-5, 5], [-9, 9]]).T
        self.states = rng.uniform(*span, (N_SAMPLES, 4)).T
        self.volts = rng.uniform(-20, 20, (1, N_SAMPLES))
        self.symbols = ca.SX.sym("p", len(NAMES))
        self.machine = SimpleNamespace(
            **dict(zip(NAMES, ca.vertsplit(self.symbols), strict=True)),
            n_legs=n_legs,
            pendulum_reach=None,
            hub_friction=0.0,  # tests/rimless_gym/test_friction.py has the dry friction
            gear_loss=0.0,
            friction_width=0.1,
            motor_mount=mount,
            impact_law="plastic",
        )
        self.p = shorthand(self.machine, ca.sin, ca.cos)
        self.x, self.u = ca.SX.sym("x", 4), ca.SX.sym("u")

    def numbers(self, *expressions: ca.SX) -> list[np.ndarray]:
        """Values of the expressions at all samples, stacked along the first axis."""
        function = ca.Function("f", [self.symbols, self.x, self.u], list(expressions))
        results = function(self.values, self.states, self.volts)
        results = results if len(expressions) > 1 else [results]
        return [
            np.asarray(result).reshape(expression.shape[0], N_SAMPLES, -1).transpose(1, 0, 2)
            for result, expression in zip(results, expressions, strict=True)
        ]


@pytest.fixture(scope="module", params=["wheel", "frame"])
def case(request):
    return Case(request.param)


def floating_base(case: Case) -> dict[str, ca.SX]:
    """Inertia, forces and the foot's Jacobian of the free machine, on the stance foot at x."""
    m, (phi, theta, dphi, dtheta) = case.machine, ca.vertsplit(case.x)
    q, v = ca.SX.sym("q", 4), ca.SX.sym("v", 4)
    hub, hub_velocity = q[:2], v[:2]
    bob = hub + m.pendulum_length * ca.vertcat(ca.sin(q[3]), -ca.cos(q[3]))
    bob_velocity = ca.jtimes(bob, q, v)
    foot = hub + m.leg_length * ca.vertcat(ca.cos(q[2]), -ca.sin(q[2]))
    relative = v[3] + v[2] if m.motor_mount == "wheel" else v[3]
    rotor = m.rotor_inertia * m.gear_ratio**2

    kinetic = (
        m.wheel_mass * ca.sumsqr(hub_velocity)
        + m.pendulum_mass * ca.sumsqr(bob_velocity)
        + m.wheel_inertia * v[2] ** 2
        + m.pendulum_inertia * v[3] ** 2
        + rotor * relative**2
    ) / 2
    down = m.gravity * ca.vertcat(ca.sin(m.slope), -ca.cos(m.slope))
    potential = -m.wheel_mass * ca.dot(down, hub) - m.pendulum_mass * ca.dot(down, bob)
    momentum = ca.gradient(kinetic, v)
    bias = ca.jtimes(momentum, q, v) - ca.gradient(kinetic - potential, q)

    shaft = m.motor_constant * m.gear_ratio
    torque = shaft * (case.u - shaft * relative) / m.armature_resistance - m.hub_damping * relative
    drag = -m.drag * ca.norm_2(hub_velocity) * hub_velocity
    applied = ca.gradient(relative, v) * torque + ca.vertcat(drag, 0, 0)

    foot_jacobian = ca.jacobian(foot, q)
    foot_bias = ca.jtimes(ca.mtimes(foot_jacobian, v), q, v)
    on_foot = ca.vertcat(
        *(-m.leg_length * ca.cos(phi), m.leg_length * ca.sin(phi), phi, theta),
    )
    moving = ca.vertcat(
        m.leg_length * ca.sin(phi) * dphi, m.leg_length * ca.cos(phi) * dphi, dphi, dtheta
    )
    results = {
        "inertia": ca.reshape(ca.hessian(kinetic, v)[0], 16, 1),
        "force": applied - bias,
        "foot_jacobian": ca.reshape(foot_jacobian, 8, 1),
        "foot_bias": foot_bias,
        "velocity": v,
        "energy": kinetic + potential,
    }
    return {
        name: ca.substitute(value, ca.vertcat(q, v), ca.vertcat(on_foot, moving))
        for name, value in results.items()
    }


def samples(case: Case) -> SimpleNamespace:
    model = floating_base(case)
    values = dict(zip(model, case.numbers(*model.values()), strict=True))
    inertia = values["inertia"].reshape(-1, 4, 4)
    jacobian = values["foot_jacobian"].reshape(-1, 4, 2).transpose(0, 2, 1)  # CasADi: by columns
    return SimpleNamespace(**values | {"inertia": inertia, "foot_jacobian": jacobian})


def constrained(inertia, jacobian, right, right_constraint):
    """Solution of the linear system above: (accelerations, multipliers)."""
    n, rows = len(inertia), jacobian.shape[1]
    matrix = np.zeros((n, 4 + rows, 4 + rows))
    matrix[:, :4, :4] = inertia
    matrix[:, :4, 4:] = -jacobian.transpose(0, 2, 1)
    matrix[:, 4:, :4] = jacobian
    solution = np.linalg.solve(matrix, np.concatenate([right, right_constraint], axis=1))
    return solution[:, :4], solution[:, 4:]


def close(ours, theirs, tolerance=1e-9):
    scale = 1 + np.abs(theirs).max(axis=tuple(range(1, theirs.ndim)), keepdims=True)
    assert np.max(np.abs(ours - theirs) / scale) < tolerance


def single_stance(case):
    return eq.single_stance(*ca.vertsplit(case.x), case.u, case.p)


def test_energy_is_that_of_two_masses_and_a_rotor(case):
    ours = case.numbers(eq.mechanical_energy(*ca.vertsplit(case.x), case.p))[0]
    close(ours, samples(case).energy, 1e-12)


def test_accelerations_and_ground_reaction_are_those_of_a_free_machine_pinned_at_its_foot(case):
    free = samples(case)
    theirs, reaction = constrained(free.inertia, free.foot_jacobian, free.force, -free.foot_bias)
    acceleration = single_stance(case)
    ours, force = case.numbers(
        ca.vertcat(*acceleration),
        ca.vertcat(*eq.ground_reaction(*ca.vertsplit(case.x), *acceleration, case.p)),
    )
    close(ours, theirs[:, 2:])
    close(force, reaction)


def test_double_stance_is_a_free_machine_whose_wheel_is_held(case):
    leg = case.p.a
    case_at_rest = Case(case.machine.motor_mount)
    case_at_rest.states[0], case_at_rest.states[2] = leg, 0.0
    free = samples(case_at_rest)
    held = np.tile(np.eye(4)[:3], (N_SAMPLES, 1, 1))
    theirs, reaction = constrained(free.inertia, held, free.force, np.zeros((N_SAMPLES, 3, 1)))
    _, theta, _, dtheta = ca.vertsplit(case_at_rest.x)
    standing = eq.double_stance(
        case_at_rest.p.a, theta, 0.0, dtheta, case_at_rest.u, case_at_rest.p
    )
    force = eq.ground_reaction(leg, theta, 0, dtheta, 0, standing, case_at_rest.p)
    ours, our_force = case_at_rest.numbers(standing, ca.vertcat(*force))
    close(ours, theirs[:, 3:])
    close(our_force, reaction[:, :2])


@pytest.mark.parametrize("n_legs", [3, 4, 5, 8])
@pytest.mark.parametrize("mount", ["wheel", "frame"])
@pytest.mark.parametrize("direction", [1, -1])
def test_plastic_touchdown_projects_onto_the_rates_that_hold_the_new_foot(mount, n_legs, direction):
    case = Case(mount, n_legs)
    p = case.p
    old, new = (p.b, p.a) if direction > 0 else (p.a, p.b)
    case.states[0] = old
    free = samples(case)
    foot = Case(mount, n_legs)  # the same machines, standing on the new foot
    foot.states[0] = new
    jacobian = samples(foot).foot_jacobian
    momentum = free.inertia @ free.velocity
    after, impulse = constrained(free.inertia, jacobian, momentum, np.zeros((N_SAMPLES, 2, 1)))

    _, theta, dphi, dtheta = ca.vertsplit(case.x)
    rates = eq.impact(new, old, theta, dphi, dtheta, p)
    jump = [
        after_ - before
        for after_, before in zip(
            eq.linear_momentum(new, theta, *rates, p),
            eq.linear_momentum(old, theta, dphi, dtheta, p),
            strict=True,
        )
    ]
    ours, our_impulse = case.numbers(ca.vertcat(*rates), ca.vertcat(*jump))
    close(ours, after[:, 2:])
    close(our_impulse, impulse)


def test_stopping_on_two_feet_keeps_the_pendulums_momentum_about_the_hub(case):
    case.states[0] = case.p.b
    free = samples(case)
    held = np.tile(np.eye(4)[:3], (N_SAMPLES, 1, 1))
    momentum = free.inertia @ free.velocity
    after, _ = constrained(free.inertia, held, momentum, np.zeros((N_SAMPLES, 3, 1)))
    _, theta, dphi, dtheta = ca.vertsplit(case.x)
    ours = case.numbers(eq.stop_on_two_feet(case.p.b, theta, dphi, dtheta, case.p))[0]
    close(ours, after[:, 3:])


def test_a_wheel_without_pendulum_loses_the_textbook_share_of_its_rate():
    for n_legs, inertia in ((5, 0.0), (5, 0.3), (8, 0.1)):
        wheel = WheelParams(
            n_legs=n_legs, wheel_inertia=inertia, pendulum_length=0.0, pendulum_inertia=0.1
        )
        p, moment = wheel.constants, wheel.total_mass * wheel.leg_length**2
        eta = (inertia + moment * math.cos(2 * math.pi / n_legs)) / (inertia + moment)
        rates = eq_numbers.impact(p.a, p.b, 0.3, 1.7, -0.4, p)
        assert rates == pytest.approx((eta * 1.7, -0.4), rel=1e-14)


def test_passive_rolling_has_the_textbook_fixed_point():
    wheel = WheelParams(
        n_legs=8,
        slope=0.08,
        wheel_inertia=0.0,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )
    p, a, half = wheel.constants, wheel.constants.a, wheel.leg_angle / 2
    push = 4 * wheel.gravity / p.L1 * math.sin(half) * math.sin(wheel.slope)
    rate = math.sqrt(push) / math.tan(2 * half)
    energy = eq_numbers.mechanical_energy(a, 0.0, rate, 0.0, p)
    drop = energy - eq_numbers.mechanical_energy(p.b, 0.0, 0.0, 0.0, p)
    before = math.sqrt(2 * drop / (wheel.total_mass * p.L1**2))
    assert eq_numbers.impact(a, p.b, 0.0, before, 0.0, p)[0] == pytest.approx(rate, rel=1e-12)


def test_the_wheels_rate_after_touchdown_does_not_depend_on_the_pendulums():
    p = THESIS_PHYSICAL.constants
    kept = [
        [eq_numbers.impact(p.a, p.b, theta, 1.0, dtheta, p)[0] for dtheta in (-8.0, 0.0, 5.0)]
        for theta in np.linspace(-math.pi, math.pi, 721)
    ]
    assert np.ptp(kept, axis=1).max() < 1e-12
    assert (round(np.min(kept), 2), round(np.max(kept), 2)) == (0.21, 0.69)
