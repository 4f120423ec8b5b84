"""The work of a step in which V i or T psi' changes sign, split there.

The ledger's max(V i, 0) and |T psi'| need it: with V held, the current changes sign where psi' is
V / K, and the shaft's power there and where psi' does.
"""

from __future__ import annotations

import numpy as np

from rimless_gym.hybrid import relative_rate
from rimless_gym.jit import inlined, vectorised
from rimless_gym.kernel import tile as of
from rimless_gym.kernel.interpolation import derivative, quintic, slope, value
from rimless_gym.kernel.tile import LANES, get_pair, get_state, machine


@inlined
def _relative_motion(tile, lane, p):
    """Quintics of psi and of the integral of psi'^2 over the attempt, and psi' at its ends."""
    y, end, h = (
        get_state(tile, of.STATE, lane),
        get_state(tile, of.NEXT, lane),
        tile[of.STEP + lane],
    )
    acc, acc_end = get_pair(tile, of.ACC, lane), get_pair(tile, of.NEXT_ACC, lane)
    turn, q = relative_rate(end[0] - y[0], end[1] - y[1], p), tile[of.TURNED + lane]
    rate0, rate1 = relative_rate(y[2], y[3], p), relative_rate(end[2], end[3], p)
    accel0, accel1 = relative_rate(acc[0], acc[1], p), relative_rate(acc_end[0], acc_end[1], p)
    angle = quintic(0.0, rate0, accel0, turn, rate1, accel1, h)
    square = quintic(0.0, rate0**2, 2 * rate0 * accel0, q, rate1**2, 2 * rate1 * accel1, h)
    return angle, square, rate0, rate1


@inlined
def _work_until(s, angle, square, u, h, p):
    """Electrical and shaft work of the first part of a step."""
    turn = value(angle, s)
    return u * (u * h * s - p.K * turn) * p.G, p.K * (u * turn - p.K * value(square, s)) * p.G


@vectorised
def split_at_current(tile):
    """Split the work of a step where the current, and so V i and T psi', changes sign.

    There the integrand is zero: two Newton steps from the secant leave an error below rounding.
    """
    for lane in range(LANES):
        u, h, p = tile[of.VOLTAGE + lane], tile[of.STEP + lane], machine(tile, lane)
        angle, square, rate0, rate1 = _relative_motion(tile, lane, p)
        s = _crossing(rate0, rate1, u / p.K, angle, h)
        electrical, work = _work_until(s, angle, square, u, h, p)
        if tile[of.FLAG + lane] == of.CURRENT:
            rest = tile[of.WORK_ELECTRICAL + lane] - electrical
            tile[of.WORK_POSITIVE + lane] = max(electrical, 0.0) + max(rest, 0.0)
            all_work = tile[of.WORK_ELECTRICAL + lane] - tile[of.WORK_COPPER + lane]
            tile[of.WORK_SHAFT + lane] = abs(work) + abs(all_work - work)


@vectorised
def split_work(tile):
    """Split the work of a step wherever V i or T psi' changes sign."""
    for lane in range(LANES):
        u, h, p = tile[of.VOLTAGE + lane], tile[of.STEP + lane], machine(tile, lane)
        angle, square, rate0, rate1 = _relative_motion(tile, lane, p)
        s_current = _crossing(rate0, rate1, u / p.K if p.K > 0.0 else np.inf, angle, h)
        s_rate = _crossing(rate0, rate1, 0.0, angle, h)
        part, _ = _work_until(s_current, angle, square, u, h, p)
        _, work0 = _work_until(min(s_current, s_rate), angle, square, u, h, p)
        _, work1 = _work_until(max(s_current, s_rate), angle, square, u, h, p)
        if tile[of.FLAG + lane] == of.SPLIT:
            rest = tile[of.WORK_ELECTRICAL + lane] - part
            work = tile[of.WORK_ELECTRICAL + lane] - tile[of.WORK_COPPER + lane]
            tile[of.WORK_POSITIVE + lane] = max(part, 0.0) + max(rest, 0.0)
            tile[of.WORK_SHAFT + lane] = abs(work0) + abs(work1 - work0) + abs(work - work1)


@inlined
def _crossing(rate0, rate1, level, angle, h):
    """Fraction of a step at which psi' crosses a level; 1 where it does not."""
    s = (level - rate0) / (rate1 - rate0)
    rate = derivative(angle)
    for _ in range(2):
        newton = s - (value(rate, s) - level * h) / slope(rate, s)
        s = min(max(newton, 0.0), 1.0)
    return s if (rate0 - level) * (rate1 - level) < 0.0 else 1.0
