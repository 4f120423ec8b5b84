"""Booking a step's energies and extremes into the row array of `rimless_gym.energy`.

With V held, the electrical integrals are exact in the step's own solution:
integral of V i = V (V t - K delta psi) / Rm, and the others need only Q, the integral of psi'^2.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rimless_gym import energy as row
from rimless_gym.hybrid import (
    ground_reaction,
    linear_momentum,
    mechanical_energy,
    pendulum_clearance,
    relative_rate,
)
from rimless_gym.interpolation import derivative, negative, quintic, upward_root, value


@njit(error_model="numpy")
def book_motion(y0, acc0, y1, acc1, h, u, q, drag, p, out):
    """Add a smooth step's energies, split where V i or T psi' changes sign."""
    turn = relative_rate(y1[0] - y0[0], y1[1] - y0[1], p)
    rate0, rate1 = relative_rate(y0[2], y0[3], p), relative_rate(y1[2], y1[3], p)
    accel0, accel1 = relative_rate(acc0[0], acc0[1], p), relative_rate(acc1[0], acc1[1], p)
    electrical = u * (u * h - p.K * turn) / p.Rm
    out[row.ELECTRICAL] += electrical
    out[row.COPPER] += (u * u * h - 2 * u * p.K * turn + p.K * p.K * q) / p.Rm
    out[row.FRICTION] += p.damping * q
    out[row.DRAG] += drag
    current_flips = (u - p.K * rate0) * (u - p.K * rate1) < 0.0
    rate_flips = rate0 * rate1 < 0.0
    work = p.K * (u * turn - p.K * q) / p.Rm
    if not (current_flips or rate_flips):
        out[row.ELECTRICAL_POSITIVE] += max(electrical, 0.0)
        out[row.SHAFT] += abs(work)
        return
    angle = quintic(0.0, rate0, accel0, turn, rate1, accel1, h)
    square = quintic(0.0, rate0**2, 2 * rate0 * accel0, q, rate1**2, 2 * rate1 * accel1, h)
    rate = derivative(angle)
    s_current, s_rate = 1.0, 1.0
    if current_flips:
        excess = (rate[0] - u * h / p.K, rate[1], rate[2], rate[3], rate[4], 0.0)
        s_current = upward_root(excess if rate1 > rate0 else negative(excess), 1.0)
    if rate_flips:
        s_rate = upward_root(rate if rate1 > rate0 else negative(rate), 1.0)
    part = u * (u * h * s_current - p.K * value(angle, s_current)) / p.Rm
    out[row.ELECTRICAL_POSITIVE] += max(part, 0.0) + max(electrical - part, 0.0)
    first, second = min(s_current, s_rate), max(s_current, s_rate)
    work0 = p.K * (u * value(angle, first) - p.K * value(square, first)) / p.Rm
    work1 = p.K * (u * value(angle, second) - p.K * value(square, second)) / p.Rm
    out[row.SHAFT] += abs(work0) + abs(work1 - work0) + abs(work - work1)


@njit(error_model="numpy")
def book_touchdown(y0, y1, shift, descent, p, out):
    """Add a touchdown's loss, and the friction that its impulse demands."""
    before = mechanical_energy(y0[0], y0[1], y0[2], y0[3], p)
    after = mechanical_energy(y1[0], y1[1], y1[2], y1[3], p) - shift * descent
    out[row.COLLISION] += before - after
    out[row.TOUCHDOWNS] += 1
    x0, z0 = linear_momentum(y0[0], y0[1], y0[2], y0[3], p)
    x1, z1 = linear_momentum(y1[0], y1[1], y1[2], y1[3], p)
    demand = abs(x1 - x0) / (z1 - z0) if z1 > z0 else np.inf
    out[row.IMPULSE_FRICTION_DEMAND] = max(out[row.IMPULSE_FRICTION_DEMAND], demand)


@njit(error_model="numpy")
def book_extremes(y, acc, p, out):
    """Update the ground reaction and its extremes, and the pendulum's least clearance."""
    fx, fy = ground_reaction(y[0], y[1], y[2], y[3], acc[0], acc[1], p)
    out[row.FORCE_X], out[row.FORCE_Y] = fx, fy
    out[row.MIN_NORMAL_FORCE] = min(out[row.MIN_NORMAL_FORCE], fy)
    demand = abs(fx) / fy if fy > 0.0 else np.inf
    out[row.FRICTION_DEMAND] = max(out[row.FRICTION_DEMAND], demand)
    out[row.CLEARANCE] = min(out[row.CLEARANCE], pendulum_clearance(y[0], y[1], p))
