"""The hybrid model's functions for callers in Python: compiled, and kept on disk between processes.

They take the machine as an array of constants, and compute together what is asked for together:
every function compiled costs a new process some tenths of a second.
"""

from __future__ import annotations

from numba import njit
from numba.np.unsafe.ndarray import to_fixed_tuple

from rimless_gym import hybrid
from rimless_gym.fingerprint import SOURCE_FINGERPRINT
from rimless_gym.params import N_CONSTANTS, Constants


def _compiled(fingerprint):

    @njit(error_model="numpy", cache=True)
    def rates(mode, phi, theta, dphi, dtheta, u, constants):
        fingerprint  # noqa: B018  see `rimless_gym.fingerprint`
        return hybrid.rates(mode, phi, theta, dphi, dtheta, u, constants)

    @njit(error_model="numpy", cache=True)
    def guards(mode, phi, theta, dphi, dtheta, u, pull, constants):
        fingerprint  # noqa: B018
        return hybrid.guards(mode, phi, theta, dphi, dtheta, u, pull, constants)

    @njit(error_model="numpy", cache=True)
    def measured(mode, phi, theta, dphi, dtheta, u, constants):
        """(Fx, Fy), mechanical energy, momentum, the hub's x and the pendulum's clearance."""
        fingerprint  # noqa: B018
        p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
        ddphi, ddtheta = hybrid.accelerations(mode, phi, theta, dphi, dtheta, u, p)
        force = hybrid.ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p)
        energy = hybrid.mechanical_energy(phi, theta, dphi, dtheta, p)
        momentum = hybrid.linear_momentum(phi, theta, dphi, dtheta, p)
        hub, clearance = hybrid.hub_position(phi, p)[0], hybrid.pendulum_clearance(phi, theta, p)
        return force, energy, momentum, hub, clearance

    @njit(error_model="numpy", cache=True)
    def after_touchdown(direction, theta, dphi, dtheta, u, constants):
        fingerprint  # noqa: B018
        p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
        return hybrid.after_touchdown(direction, theta, dphi, dtheta, u, p)

    @njit(error_model="numpy", cache=True)
    def after_lift_off(theta, dtheta, u, constants):
        fingerprint  # noqa: B018
        p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
        return hybrid.after_lift_off(theta, dtheta, u, p)

    return rates, guards, measured, after_touchdown, after_lift_off


rates, guards, measured, after_touchdown, after_lift_off = _compiled(SOURCE_FINGERPRINT)
