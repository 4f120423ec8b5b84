"""The hybrid model's functions for callers in Python: compiled, and kept on disk between processes.

They take the machine as an array of constants. One function computes all the values that callers
need together, because every compiled function costs a new process some tenths of a second.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.np.unsafe.ndarray import to_fixed_tuple

from rimless_gym import hybrid
from rimless_gym.constants import N_CONSTANTS, Constants
from rimless_gym.jit import REFERENCE, kept


@kept()
def rates(mode, phi, theta, dphi, dtheta, u, constants):
    """Two tuples: the state's rates with electrical and shaft power, and the losses' powers.

    All are smooth. The shaft power is what the motor delivers to wheel and pendulum.
    """
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    ddphi, ddtheta = hybrid.accelerations(mode, phi, theta, dphi, dtheta, u, p)
    dpsi = hybrid.relative_rate(dphi, dtheta, p)
    electrical, shaft = hybrid.electrical_power(dpsi, u, p), hybrid.shaft_power(dpsi, u, p)
    motion = dphi, dtheta, ddphi, ddtheta, electrical, shaft
    return motion, hybrid.losses(dphi, dpsi, hybrid.relative_rate(ddphi, ddtheta, p), u, p)


@kept(REFERENCE)
def guards(mode, phi, theta, dphi, dtheta, u, pull, constants):
    """`hybrid.guards`."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return hybrid.guards(mode, phi, theta, dphi, dtheta, u, pull, p)


class Measured(NamedTuple):
    """What is known of a state at a voltage.

    Attributes:
        force: (Fx, Fy) on the foot, or on both (N).
        demand: the friction coefficient that it needs.
        energy: mechanical, measured from the stance foot (J).
        momentum: (x, y) of the machine (N s).
        hub: its x from the stance foot (m).
        clearance: of the pendulum's end (m).
    """

    force: Any
    demand: Any
    energy: Any
    momentum: Any
    hub: Any
    clearance: Any


@kept()
def measured(mode, phi, theta, dphi, dtheta, u, constants):
    """(Fx, Fy), mechanical energy, momentum, the hub's x and the pendulum's clearance."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    ddphi, ddtheta = hybrid.accelerations(mode, phi, theta, dphi, dtheta, u, p)
    force = hybrid.ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p)
    energy = hybrid.mechanical_energy(phi, theta, dphi, dtheta, p)
    momentum = hybrid.linear_momentum(phi, theta, dphi, dtheta, p)
    hub, clearance = hybrid.hub_position(phi, p)[0], hybrid.pendulum_clearance(phi, theta, p)
    demand = hybrid.friction_demand(force[0], force[1])
    return Measured(force, demand, energy, momentum, hub, clearance)


@kept()
def after_touchdown(direction, theta, dphi, dtheta, u, constants):
    """`hybrid.after_touchdown`."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return hybrid.after_touchdown(direction, theta, dphi, dtheta, u, p)


@kept()
def after_lift_off(theta, dtheta, u, constants):
    """See `Measured`."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return hybrid.after_lift_off(theta, dtheta, u, p)
