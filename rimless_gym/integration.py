"""One 8th-order Runge-Kutta step of the smooth motion between events (Dormand-Prince, DOP853)."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from rimless_gym.hybrid import accelerations, losses, relative_rate

STAGES = 12
_A = np.ascontiguousarray(DOP853.A)
_B = np.ascontiguousarray(DOP853.B)


@njit(error_model="numpy", fastmath={"contract"})
def rk8(mode, y, acc, u, h, p, k):
    """The state after h, and the integrals over h of psi'^2 and of the air drag's power.

    `y` is (phi, theta, phi', theta'), `acc` its (phi'', theta''), `k` scratch of 4 * STAGES.
    """
    phi, theta, dphi, dtheta = y
    v0, v1 = dphi, dtheta
    k[0], k[1], k[2], k[3] = v0, v1, acc[0], acc[1]
    dpsi = relative_rate(v0, v1, p)
    q = _B[0] * dpsi * dpsi
    d = _B[0] * losses(v0, dpsi, u, p)[2]
    for i in range(1, STAGES):
        s0 = s1 = s2 = s3 = 0.0
        for j in range(i):
            w = _A[i, j]
            s0 += w * k[4 * j]
            s1 += w * k[4 * j + 1]
            s2 += w * k[4 * j + 2]
            s3 += w * k[4 * j + 3]
        v0, v1 = dphi + h * s2, dtheta + h * s3
        a0, a1 = accelerations(mode, phi + h * s0, theta + h * s1, v0, v1, u, p)
        k[4 * i], k[4 * i + 1], k[4 * i + 2], k[4 * i + 3] = v0, v1, a0, a1
        dpsi = relative_rate(v0, v1, p)
        q += _B[i] * dpsi * dpsi
        d += _B[i] * losses(v0, dpsi, u, p)[2]
    s0 = s1 = s2 = s3 = 0.0
    for j in range(STAGES):
        w = _B[j]
        s0 += w * k[4 * j]
        s1 += w * k[4 * j + 1]
        s2 += w * k[4 * j + 2]
        s3 += w * k[4 * j + 3]
    return (phi + h * s0, theta + h * s1, dphi + h * s2, dtheta + h * s3), h * q, h * d
