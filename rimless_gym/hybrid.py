"""The hybrid automaton: which mode the wheel is in, and what a touchdown or lift-off does.

numba compiles the equations of `rimless_gym.equations` with sines and cosines that vectorise. They
are always inlined, because a loop that contains a call does not vectorise. Both simulators, the
stepping kernel and the SciPy reference, take their equations, guards, reset maps and thresholds
from this file. They differ only in how they integrate and locate events.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

from rimless_gym.equations import (
    DOUBLE,
    RELABEL,
    SINGLE,
    THESIS,
    Accelerations,
    equations,
)
from rimless_gym.jit import inlined, inner
from rimless_gym.trigonometry import cos, cos_turned, sin, sin_turned


class Failure(enum.IntEnum):
    """Why an advance of the hybrid state ended early.

    Attributes:
        NONE: it did not end early.
        CONTACT_LOST: the ground would have to pull the feet down.
        RATE_EXCEEDED: the leg or the pendulum turns faster than `MAX_RATE`.
        TOO_MANY_EVENTS: more than `MAX_EVENTS` per control period.
        BACKWARD_TOUCHDOWN_UNDER_THE_THESIS_LAW: that impact law does not cover backward touchdowns.
        DIVERGED: the rates are so large, or NaN, that an integration step cannot be trusted.
    """

    NONE = 0
    CONTACT_LOST = 1
    RATE_EXCEEDED = 2
    TOO_MANY_EVENTS = 3
    BACKWARD_TOUCHDOWN_UNDER_THE_THESIS_LAW = 4
    DIVERGED = 5


# The same as plain integers, for compiled code.
OK, CONTACT_LOST, RATE_EXCEEDED, TOO_MANY_EVENTS, THESIS_BACKWARD, DIVERGED = map(int, Failure)

#: Kinetic energy of the wheel, in units of (m1+m2) g L1, below which a touchdown ends in double
#: stance if both feet would press there. It cuts short the Zeno sequence of ever smaller ones.
REST_ENERGY = 1e-8

#: Zero-order hold of the environment and of sampled controls (s).
CONTROL_PERIOD = 0.01

#: Most touchdowns and lift-offs per control period; more are an error.
MAX_EVENTS = 200

#: Shortest mean time (s) between the touchdowns of a wheel rocking on two feet under the impact law
#: "relabel", which takes no energy from it. A wheel that rocks faster is brought to rest. This is
#: twice the shortest time that `MAX_EVENTS` allows.
SHORTEST_ROCKING = 2 * CONTROL_PERIOD / MAX_EVENTS

#: Fastest rate (rad/s) of leg or pendulum that the model covers.
MAX_RATE = 60.0

eq = equations(sin, cos, inlined)
#: The same equations, for phi and theta as `rimless_gym.trigonometry.sin_turned` takes angles.
turned = equations(sin_turned, cos_turned, inlined)

# Compiled code can only call functions that are names of a module.
hub_position = eq.hub_position
relative_rate = eq.relative_rate
mass_matrix = eq.mass_matrix
kinetic_energy = eq.kinetic_energy
mechanical_energy = eq.mechanical_energy
motor_charge = eq.motor_charge
motor_current = eq.motor_current
motor_voltage = eq.motor_voltage
motor_torque = eq.motor_torque
electrical_power = eq.electrical_power
shaft_power = eq.shaft_power
crosses_kink = eq.crosses_kink
friction_demand = eq.friction_demand
descent = eq.descent
foot_travel = eq.foot_travel
least_regularity = eq.least_regularity
losses = eq.losses
single_stance = eq.single_stance
double_stance = eq.double_stance
lift_off_guards = eq.lift_off_guards
touchdown_guard = eq.touchdown_guard
lift_off_guard = eq.lift_off_guard
contact_guard = eq.contact_guard
impact = eq.impact
stop_on_two_feet = eq.stop_on_two_feet
push = eq.push
ground_reaction = eq.ground_reaction
linear_momentum = eq.linear_momentum
pendulum_clearance = eq.pendulum_clearance
regularity = eq.regularity
psi_mobility = eq.psi_mobility
hub_pole = eq.hub_pole
gear_torque = eq.gear_torque
friction_pole = eq.friction_pole
drag_pole = eq.drag_pole
swing_frequency = eq.swing_frequency


def _in_either_mode(eq: SimpleNamespace) -> Callable[..., Any]:
    single_stance, double_stance = eq.single_stance, eq.double_stance

    @inlined
    def accelerations(mode, phi, theta, dphi, dtheta, u, p):
        """(phi'', theta'') in either stance mode, without a branch, so that loops vectorise."""
        ddphi, ddtheta = single_stance(phi, theta, dphi, dtheta, u, p)
        standing = double_stance(phi, theta, dphi, dtheta, u, p)
        stands = mode == DOUBLE
        return Accelerations(0.0 if stands else ddphi, standing if stands else ddtheta)

    return accelerations


accelerations, accelerations_turned = _in_either_mode(eq), _in_either_mode(turned)


@inner
def foot_force(mode, phi, theta, dphi, dtheta, u, p):
    """Fy (N) on the foot, or on both feet together."""
    ddphi, ddtheta = accelerations(mode, phi, theta, dphi, dtheta, u, p)
    return ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p)[1]


@inner
def both_feet_press(theta, dtheta, u, p):
    """Whether a wheel at rest on two feet stays there."""
    leading, trailing = lift_off_guards(theta, dtheta, u, p)
    return leading <= 0.0 <= trailing


@inner
def rocks_too_fast(theta, dphi, dtheta, u, p):
    """Whether a wheel that leaves two feet at phi' would be back sooner than `SHORTEST_ROCKING`.

    The time is the mean over both feet of 2 phi' / |phi''|, with phi'' of the wheel at rest. Both
    feet must press.
    """
    leading, trailing = lift_off_guards(theta, dtheta, u, p)
    return abs(dphi) * (trailing - leading) < SHORTEST_ROCKING * trailing * -leading


@inner
def guards(mode, phi, theta, dphi, dtheta, u, pull, p):
    """Guards, positive once passed: touchdown forward, touchdown backward, lift-off, contact."""
    contact = contact_guard(foot_force(mode, phi, theta, dphi, dtheta, u, p), pull)
    if mode == DOUBLE:
        return -1.0, -1.0, lift_off_guard(theta, dtheta, u, p), contact
    return touchdown_guard(1, phi, p), touchdown_guard(-1, phi, p), -1.0, contact


class Landing(NamedTuple):
    """The state after a touchdown.

    Attributes:
        mode: stance mode.
        phi: angle of the new stance leg; in double stance, of the leading leg (rad).
        dphi: its rate (rad/s).
        dtheta: the pendulum's rate (rad/s).
        shift: number of legs by which the stance foot has moved forward.
        legal: whether the impact law covers the touchdown; if not, the rest is the state before.
    """

    mode: Any
    phi: Any
    dphi: Any
    dtheta: Any
    shift: Any
    legal: Any


@inner
def after_touchdown(direction, theta, dphi, dtheta, u, p):
    """The state after a touchdown, a `Landing`.

    `direction` is +1 at phi = b rising, -1 at phi = a falling. The wheel goes on over the new foot
    if it still moves in that direction after the impact; otherwise it comes to rest on both feet.
    It also comes to rest if both feet would press and it is slow: its kinetic energy is below
    `REST_ENERGY`, or, under the impact law "relabel", it would rock faster than `SHORTEST_ROCKING`.
    """
    if direction > 0:
        phi_old, phi_new = p.b, p.a
    else:
        phi_old, phi_new = p.a, p.b
        if p.law == THESIS:
            return Landing(SINGLE, phi_old, dphi, dtheta, 0, False)
    dphi_new, dtheta_new = impact(phi_new, phi_old, theta, dphi, dtheta, p)
    dtheta_rest = stop_on_two_feet(phi_old, theta, dphi, dtheta, p)
    m11 = mass_matrix(phi_new, theta, p)[0]
    slow = 0.5 * m11 * dphi_new**2 < REST_ENERGY * p.S1 * math.hypot(p.gx, p.gy)
    if p.law == RELABEL:
        slow = slow or rocks_too_fast(theta, dphi_new, dtheta_rest, u, p)
    if direction * dphi_new > 0 and not (slow and both_feet_press(theta, dtheta_rest, u, p)):
        return Landing(SINGLE, phi_new, dphi_new, dtheta_new, direction, True)
    return Landing(DOUBLE, p.a, 0.0, dtheta_rest, max(direction, 0), True)


@inner
def after_lift_off(theta, dtheta, u, p):
    """(phi, foot shift) after a foot of a wheel at rest lifts off.

    The foot that would be pulled harder lifts off. If that is the trailing foot, the wheel goes
    forward.
    """
    leading, trailing = lift_off_guards(theta, dtheta, u, p)
    if leading > -trailing:
        return p.a, 0
    return p.b, -1
