"""The physics, written once.

`equations(sin, cos, ...)` returns plain functions of scalars. numba compiles these lines for
stepping (`rimless_gym.hybrid`), and CasADi traces the same lines for optimisation
(`rimless_gym.symbolic`). There is no other copy of an equation of motion, guard or impact map.

Notation of Mihevc (2015), in the frame of the ground (x downhill along it, y normal to it):

    hub          = foot + L1 (-cos phi, sin phi)        phi: stance leg from the ground
    pendulum CoM = hub  + L2 (sin theta, -cos theta)    theta: pendulum from the ground's normal
    psi          = theta + d1 (phi - pi/2)              what the motor turns (3.47, 3.48)

``p`` is a `rimless_gym.params.Constants`. Rates are written ``dphi``, ``dtheta``.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any, NamedTuple


def record(name: str, fields: Iterable[str], module: str) -> Any:
    """A named tuple class with fields from a table.

    Pickles need `module`, in which it is assigned to `name`.
    """
    return namedtuple(name, list(fields), module=module)


def places(kind: Any) -> Any:
    """The named tuple (0, 1, 2, ...): the index of each field of `kind` in an array."""
    return kind(*range(len(kind._fields)))


#: Names of the stance modes.
MODE_NAMES = ("single_stance", "double_stance")
SINGLE, DOUBLE = range(len(MODE_NAMES))

#: Names of the impact laws; `impact` has what each does.
IMPACT_LAWS = ("plastic", "relabel", "thesis")
PLASTIC, RELABEL, THESIS = range(3)

#: The losses of smooth motion, each with its power. A new loss is an entry here, its power in
#: `losses` and its torque in `hub_torque`, `dry_friction` or `forces`: the ledger, the simulators,
#: `info`, the logs and the documents take their names and numbers from this table.
LOSSES = {
    "copper": "i^2 Rm in the motor's windings",
    "damping": "viscous friction at the hub",
    "friction": "dry friction at the hub without load",
    "gear": "what the gear loses besides, because it transmits a torque",
    "drag": "air drag on the hub",
    "windage": "air drag on the turning pendulum",
}
Losses = record("Losses", LOSSES, __name__)  # powers (W), or energies (J)


class State(NamedTuple):
    """The smooth state: angles (rad) and their rates (rad/s)."""

    phi: Any
    theta: Any
    dphi: Any
    dtheta: Any


class Accelerations(NamedTuple):
    """Accelerations of the two angles (rad/s^2)."""

    ddphi: Any
    ddtheta: Any


def _interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


def equations(
    sin: Callable[[Any], Any],
    cos: Callable[[Any], Any],
    compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = _interpreted,
    sqrt: Callable[[Any], Any] = math.sqrt,
) -> SimpleNamespace:
    """Every equation of the model as a function of scalars.

    Args:
        sin: sine of one scalar, of the caller's number type.
        cos: cosine of one scalar, of the same type.
        compiled: decorator applied to each function, e.g. ``numba.njit``.
        sqrt: square root of one scalar.

    Returns:
        A namespace of the functions defined below.
    """

    # -- geometry ---------------------------------------------------------------------------

    @compiled
    def angle_sum(phi, theta):
        """Sine and cosine of phi + theta, from those of phi and theta that most equations share."""
        return (
            sin(phi) * cos(theta) + cos(phi) * sin(theta),
            cos(phi) * cos(theta) - sin(phi) * sin(theta),
        )

    @compiled
    def hub_position(phi, p):
        """Position (x, y) of the hub relative to the stance foot (m)."""
        return -p.L1 * cos(phi), p.L1 * sin(phi)

    @compiled
    def pendulum_clearance(phi, theta, p):
        """Height of the pendulum's far end above the ground (m)."""
        return p.L1 * sin(phi) - p.reach * cos(theta)

    @compiled
    def relative_rate(dphi, dtheta, p):
        """psi' of the motor (3.48); with the frame mount it is theta' alone (thesis 4.4)."""
        return dtheta + p.d1 * dphi

    # -- energies ---------------------------------------------------------------------------

    @compiled
    def coupling(phi, theta, p):
        """M12 of the mass matrix (3.41), rotor included."""
        return p.Je3 * angle_sum(phi, theta)[0] + p.Jr * p.d1

    @compiled
    def mass_matrix(phi, theta, p):
        """The mass matrix (3.41) as (M11, M12, M22), rotor included."""
        return p.Je1 + p.Jr * p.d1, coupling(phi, theta, p), p.Je2 + p.Jr

    @compiled
    def touchdown_matrix(phi_new, phi_old, theta, p):
        """M(+, -) between two stance poses, as (M11, M12, M21, M22); (3.41) when they are equal.

        M(+,+) v+ = M(+,-) v- is the plastic touchdown. It conserves the angular momentum about the
        new foot, and that of the pendulum about the hub.
        """
        m11 = p.I1 + (p.Je1 - p.I1) * cos(phi_new - phi_old) + p.Jr * p.d1
        return m11, coupling(phi_new, theta, p), coupling(phi_old, theta, p), p.Je2 + p.Jr

    @compiled
    def kinetic_energy(phi, theta, dphi, dtheta, p):
        """Kinetic energy (3.27), rotor included (J)."""
        m11, m12, m22 = mass_matrix(phi, theta, p)
        return 0.5 * m11 * dphi**2 + m12 * dphi * dtheta + 0.5 * m22 * dtheta**2

    @compiled
    def potential_energy(phi, theta, p):
        """Potential energy (3.26) on a slope, measured from the stance foot (J)."""
        wheel = p.S1 * (p.gy * sin(phi) + p.gx * cos(phi))
        return wheel - p.S2 * (p.gy * cos(theta) + p.gx * sin(theta))

    @compiled
    def mechanical_energy(phi, theta, dphi, dtheta, p):
        """Kinetic and potential energy, measured from the stance foot (J)."""
        return kinetic_energy(phi, theta, dphi, dtheta, p) + potential_energy(phi, theta, p)

    # -- motor (3.49-3.53) --------------------------------------------------------------------

    @compiled
    def motor_charge(turn, u, duration, p):
        """Charge (C) through the armature while psi turns by `turn` at the held voltage u."""
        return (u * duration - p.K * turn) * p.G

    @compiled
    def motor_current(dpsi, u, p):
        """Armature current (A) at voltage u; no inductance."""
        return motor_charge(dpsi, u, 1, p)

    @compiled
    def motor_voltage(dpsi, current, p):
        """Voltage (V) that drives an armature current (A): `motor_current` solved for u."""
        return (current - motor_current(dpsi, 0, p)) / motor_current(0, 1, p)

    @compiled
    def motor_torque(dpsi, u, p):
        """Torque at the hub, after the gear (N m)."""
        return p.K * motor_current(dpsi, u, p)

    @compiled
    def electrical_power(dpsi, u, p):
        """Power drawn at the terminals, u i (W); negative when the motor brakes into them."""
        return u * motor_current(dpsi, u, p)

    @compiled
    def viscous_friction(dpsi, p):
        """Torque of viscous friction at the hub (N m), against psi'."""
        return p.damping * dpsi

    @compiled
    def hub_torque(dpsi, u, p):
        """Torque between wheel and pendulum (N m) but for `dry_friction`; affine in psi' and u."""
        return motor_torque(dpsi, u, p) - viscous_friction(dpsi, p)

    @compiled
    def shaft_power(dpsi, u, p):
        """What the motor does to wheel and pendulum (W): electrical power less the copper loss."""
        return motor_torque(dpsi, u, p) * dpsi

    @compiled
    def air_drag(dphi, p):
        """Torque about the foot of the air drag on the hub (N m), against phi'."""
        return p.Cd * abs(dphi) * dphi

    @compiled
    def windage(dtheta, p):
        """Torque of the air on the pendulum (N m), against theta'; viscous at rates below w.

        The pendulum's own turning alone counts: the air moves with the hub.
        """
        ratio = dtheta / p.w
        return p.Cp * p.w * dtheta * sqrt(ratio * ratio + 1)

    # -- dry friction of gear and bearings: F0 without load, the share c of a large load ----------

    @compiled
    def slide(dpsi, p):
        """The sign of psi', smooth where |psi'| is not large against the width w."""
        return dpsi / sqrt(dpsi * dpsi + p.w * p.w)

    @compiled
    def gear_torque(dpsi, ddpsi, u, p):
        """Torque that the gear transmits (N m): the motor's, less what turns the rotor itself."""
        return motor_torque(dpsi, u, p) - p.Jr * ddpsi

    @compiled
    def friction_level(torque, p):
        """Size of the dry friction (N m) while the gear transmits `torque`."""
        return sqrt(p.F0 * p.F0 + (p.c * torque) ** 2)

    @compiled
    def dry_friction(dpsi, free, mobility, u, p):
        """Torque of the dry friction at the hub (N m), against psi'.

        The friction depends on the torque that the gear transmits, that on psi'', and psi'' on the
        friction. The three equations make one quadratic, solved here.

        Args:
            dpsi: psi' (rad/s).
            free: psi'' without dry friction (rad/s^2).
            mobility: psi'' per torque at the hub (1 / (kg m^2)).
            u: voltage (V).
            p: the machine.
        """
        direction, loaded = slide(dpsi, p), p.c * gear_torque(dpsi, free, u, p)
        feedback = p.c * p.Jr * mobility * direction
        rest = 1 - feedback * feedback
        level = (feedback * loaded + sqrt(loaded * loaded + rest * p.F0 * p.F0)) / rest
        return direction * level

    @compiled
    def losses(dphi, dpsi, ddpsi, u, p):
        """Powers of the `LOSSES` (W)."""
        sliding = slide(dpsi, p) * dpsi
        level = friction_level(gear_torque(dpsi, ddpsi, u, p), p)
        dtheta = dpsi - p.d1 * dphi
        return Losses(
            copper=p.Rm * motor_current(dpsi, u, p) ** 2,
            damping=viscous_friction(dpsi, p) * dpsi,
            friction=p.F0 * sliding,
            gear=(level - p.F0) * sliding,
            drag=air_drag(dphi, p) * dphi,
            windage=windage(dtheta, p) * dtheta,
        )

    # -- equations of motion (3.40-3.46) --------------------------------------------------------

    @compiled
    def forces(phi, theta, dphi, dtheta, u, p):
        """Right-hand side of M v' = Q: motor, damping, air, centrifugal forces and gravity."""
        dpsi = relative_rate(dphi, dtheta, p)
        hub = hub_torque(dpsi, u, p)
        c = p.Je3 * angle_sum(phi, theta)[1]
        wheel = p.S1 * (p.gy * cos(phi) - p.gx * sin(phi))
        pendulum = p.S2 * (p.gy * sin(theta) - p.gx * cos(theta))
        q1 = p.d1 * hub - c * dtheta**2 - wheel - air_drag(dphi, p)
        return q1, hub - c * dphi**2 - pendulum - windage(dtheta, p)

    @compiled
    def solve(m11, m12, m22, r1, r2):
        """Solution of the symmetric 2 x 2 system with right-hand side (r1, r2)."""
        inverse = 1 / (m11 * m22 - m12 * m12)
        return (m22 * r1 - m12 * r2) * inverse, (m11 * r2 - m12 * r1) * inverse

    @compiled
    def single_stance(phi, theta, dphi, dtheta, u, p):
        """Accelerations (phi'', theta'') on one foot."""
        q1, q2 = forces(phi, theta, dphi, dtheta, u, p)
        m11, m12, m22 = mass_matrix(phi, theta, p)
        ddphi, ddtheta = solve(m11, m12, m22, q1, q2)
        phi_gain, theta_gain = solve(m11, m12, m22, p.d1, 1.0)  # per torque at the hub
        dpsi, free = relative_rate(dphi, dtheta, p), relative_rate(ddphi, ddtheta, p)
        friction = dry_friction(dpsi, free, relative_rate(phi_gain, theta_gain, p), u, p)
        return ddphi - phi_gain * friction, ddtheta - theta_gain * friction

    @compiled
    def double_stance(phi, theta, dphi, dtheta, u, p):
        """Acceleration theta'' with the wheel held at rest on two feet: dphi must be 0."""
        free = forces(phi, theta, dphi, dtheta, u, p)[1] * p.mobility
        dpsi = relative_rate(dphi, dtheta, p)
        return free - p.mobility * dry_friction(dpsi, free, p.mobility, u, p)

    @compiled
    def lift_off_guards(theta, dtheta, u, p):
        """phi'' of a wheel at rest if it stood on one foot alone: (leading, trailing).

        Both feet press while leading < 0 < trailing. If leading > 0, the trailing foot lifts off
        and the wheel goes forward. If trailing < 0, the leading foot lifts off and it goes back.
        """
        leading, _ = single_stance(p.a, theta, 0.0, dtheta, u, p)
        trailing, _ = single_stance(p.b, theta, 0.0, dtheta, u, p)
        return leading, trailing

    # -- guards: positive once passed ------------------------------------------------------------

    @compiled
    def touchdown_guard(direction, phi, p):
        """How far the leg is past its touchdown (rad), forward (direction 1) or backward (-1)."""
        return direction * (phi - (p.b if direction > 0 else p.a))

    @compiled
    def lift_off_guard(theta, dtheta, u, p):
        """Positive once a foot of a wheel at rest on two feet would have to be pulled down."""
        leading, trailing = lift_off_guards(theta, dtheta, u, p)
        return max(leading, -trailing)

    @compiled
    def crosses_kink(dphi, dphi_end, p):
        """Whether a loss has a kink between two rates of the leg; integration steps end there."""
        return p.Cd > 0.0 and dphi * dphi_end < 0.0

    @compiled
    def contact_guard(fy, pull):
        """How far the pull that the feet need (N) exceeds `pull`, the most the ground can exert."""
        return -pull - fy

    # -- touchdown ----------------------------------------------------------------------------

    @compiled
    def impact(phi_new, phi_old, theta, dphi, dtheta, p):
        """Rates after the stance leg changes from phi_old to phi_new, by the law in `p`."""
        m11, m12, m22 = mass_matrix(phi_new, theta, p)
        n11, n12, n21, n22 = touchdown_matrix(phi_new, phi_old, theta, p)
        if p.law == RELABEL:
            return dphi, dtheta
        if p.law == THESIS:  # (3.75-3.82) as printed
            h1, h2 = p.Je3 * sin(phi_new + theta), p.Je2
            h3, h4 = h1 - p.Je1 - p.I1, p.Je2 + p.S2 * p.L2 * (sin(phi_new + theta) - 2)
            h1_old = p.Je3 * sin(phi_old + theta)
            h5, h6 = h1_old - p.I1, p.Je3 * cos(phi_old + theta) + p.Je2
            r1, r2 = h1_old * dphi + p.Je2 * dtheta, h5 * dphi + h6 * dtheta
            det = h1 * h4 - h2 * h3
            return (h4 * r1 - h2 * r2) / det, (h1 * r2 - h3 * r1) / det
        return solve(m11, m12, m22, n11 * dphi + n12 * dtheta, n21 * dphi + n22 * dtheta)

    @compiled
    def touchdown(phi, theta, dphi, dtheta, p):
        """Forward touchdown: the state on the new stance leg (3.71, 3.72 and the impact law)."""
        dphi_new, dtheta_new = impact(phi - p.alpha, phi, theta, dphi, dtheta, p)
        return phi - p.alpha, theta, dphi_new, dtheta_new

    @compiled
    def touchdown_backward(phi, theta, dphi, dtheta, p):
        """Backward touchdown: the state on the new stance leg, the one behind."""
        dphi_new, dtheta_new = impact(phi + p.alpha, phi, theta, dphi, dtheta, p)
        return phi + p.alpha, theta, dphi_new, dtheta_new

    @compiled
    def stop_on_two_feet(phi_old, theta, dphi, dtheta, p):
        """theta' after an impact that stops the wheel; the pendulum's momentum is conserved."""
        return dtheta + coupling(phi_old, theta, p) * dphi * p.mobility

    @compiled
    def push(phi, theta, dphi, dtheta, jx, jy, p):
        """Rates after an impulse (jx, jy) in N s on the hub, with the stance foot held."""
        m11, m12, m22 = mass_matrix(phi, theta, p)
        turned = p.L1 * (jx * sin(phi) + jy * cos(phi))
        jump = solve(m11, m12, m22, turned, 0.0)
        return dphi + jump[0], dtheta + jump[1]

    # -- stiffness of a machine, and how nearly singular it is -----------------------------------

    @compiled
    def regularity(angle, p):
        """1 - M12^2 / (M11 M22) at phi + theta = `angle`; 0 where the matrix is singular.

        It is least at one of the ends of M12's range, at -pi/2 or pi/2.
        """
        m11, m12, m22 = mass_matrix(0.0, angle, p)
        return (m11 * m22 - m12 * m12) / (m11 * m22)

    @compiled
    def least_regularity(p):
        """The least `regularity` over all poses, with and without the rotor's part in M11, M12."""
        without = (p.Je1 - p.Je3 * p.Je3 * p.mobility) / p.Je1
        return min(regularity(-0.5 * math.pi, p), regularity(0.5 * math.pi, p), without)

    @compiled
    def psi_mobility(angle, p):
        """psi'' per motor torque (1 / (kg m^2)) at phi + theta = `angle`.

        It is (M11 + M22 - 2 M12) / det M, or M11 / det M with the frame mount.
        """
        m11, m12, m22 = mass_matrix(0.0, angle, p)
        ddphi, ddtheta = solve(m11, m12, m22, p.d1, 1.0)
        return relative_rate(ddphi, ddtheta, p)

    @compiled
    def greatest_mobility(p):
        """The largest `psi_mobility`: it is at one of the ends of M12's range."""
        return max(psi_mobility(-0.5 * math.pi, p), psi_mobility(0.5 * math.pi, p))

    @compiled
    def hub_pole(p):
        """Fastest rate (1/s) at which back-EMF and viscous friction damp psi', over all poses."""
        damping = hub_torque(0.0, 0.0, p) - hub_torque(1.0, 0.0, p)
        return damping * greatest_mobility(p)

    @compiled
    def friction_pole(dpsi, torque, p):
        """Rate (1/s) at which dry friction damps psi' near `dpsi`, over all poses.

        `torque` is what the gear transmits (N m).
        """
        wide = dpsi * dpsi + p.w * p.w
        return friction_level(torque, p) * greatest_mobility(p) * p.w * p.w / (wide * sqrt(wide))

    @compiled
    def least_inertia(p):
        """The pendulum's inertia (kg m^2) in the pose in which it is most mobile."""
        m12 = p.Je3 + p.Jr * p.d1
        return p.Je2 + p.Jr - m12 * m12 / (p.Je1 + p.Jr * p.d1)

    @compiled
    def drag_pole(dphi, dtheta, p):
        """Largest rate (1/s) at which the air damps phi' and theta', over all poses."""
        m12 = p.Je3 + p.Jr * p.d1  # its largest: both are most mobile there
        wheel = 2 * p.Cd * abs(dphi) / (p.Je1 + p.Jr * p.d1 - m12 * m12 * p.mobility)
        return wheel + 2 * p.Cp * (abs(dtheta) + p.w) / least_inertia(p)

    @compiled
    def swing_frequency(p):
        """Fastest that gravity swings the pendulum (rad/s), over all poses."""
        return sqrt(p.S2 * (abs(p.gx) + p.gy) / least_inertia(p))

    # -- ground ---------------------------------------------------------------------------------

    @compiled
    def ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p):
        """Force (Fx, Fy) of the ground on the stance foot (N), in the ground's frame.

        In double stance (dphi = ddphi = 0) it is the sum over both feet.
        """
        leg_x = ddphi * sin(phi) + dphi**2 * cos(phi)
        leg_y = ddphi * cos(phi) - dphi**2 * sin(phi)
        rod_x = ddtheta * cos(theta) - dtheta**2 * sin(theta)
        rod_y = ddtheta * sin(theta) + dtheta**2 * cos(theta)
        air = air_drag(dphi, p) / p.L1
        mass = p.m1 + p.m2
        fx = p.S1 * leg_x + p.S2 * rod_x - mass * p.gx + air * sin(phi)
        fy = p.S1 * leg_y + p.S2 * rod_y + mass * p.gy + air * cos(phi)
        return fx, fy

    @compiled
    def friction_demand(fx, fy):
        """|Fx| / Fy: the friction coefficient that a force or an impulse needs."""
        return abs(fx) / fy if fy > 0.0 else math.inf

    @compiled
    def foot_travel(turn, p):
        """Travel of the foot along the slope (m) in a step over ground steeper by `turn` (rad)."""
        return p.chord * cos(turn)

    @compiled
    def descent(turn, p):
        """Potential energy that such a step takes off the foot's height (J)."""
        weight = (p.m1 + p.m2) * p.gx * cos(turn) + (p.m1 + p.m2) * p.gy * sin(turn)
        return weight * p.chord

    @compiled
    def linear_momentum(phi, theta, dphi, dtheta, p):
        """Momentum (x, y) of the whole machine (N s); its jump is the touchdown's impulse."""
        px = p.S1 * dphi * sin(phi) + p.S2 * dtheta * cos(theta)
        py = p.S1 * dphi * cos(phi) + p.S2 * dtheta * sin(theta)
        return px, py

    functions = dict(locals())  # a copy: in Python 3.12, tracing changes it during a loop
    return SimpleNamespace(**{k: v for k, v in functions.items() if k not in _ARGUMENTS})


_ARGUMENTS = ("sin", "cos", "compiled", "sqrt")
