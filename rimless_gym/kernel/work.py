"""The work of a step in which V i or T psi' changes sign, split there.

The ledger's max(V i, 0) and |T psi'| need this. With V held, the current changes sign where psi' is
V / K. The shaft's power changes sign there, and where psi' does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rimless_gym.hybrid import losses, motor_charge, motor_current, relative_rate
from rimless_gym.jit import inlined, vectorised
from rimless_gym.kernel import tile as of
from rimless_gym.kernel.interpolation import derivative, quintic, slope, value
from rimless_gym.kernel.lanes import LANES
from rimless_gym.kernel.tile import get_acc, get_losses, get_state, machine


class _Course(NamedTuple):
    """How the motor turns over an attempt: quintics, and psi' at the ends.

    Attributes:
        turn: quintic of psi from its start.
        copper: quintic of the copper loss from the start (J).
        rate: psi' at the start.
        rate_end: psi' at the end.
    """

    turn: Any
    copper: Any
    rate: Any
    rate_end: Any


@inlined
def _copper_rates(rate, acceleration, u, p):
    """Power of the copper loss, and its rate of change, for psi' and psi''."""
    power = losses(0.0, rate, 0.0, u, p).copper
    change = motor_current(acceleration, 0.0, p)  # of the current, which is affine in psi'
    return power, 2 * p.Rm * motor_current(rate, u, p) * change


@inlined
def _course(tile, lane, u, h, p):
    y, end = get_state(tile, of.STATE, lane), get_state(tile, of.NEXT, lane)
    acc, acc_end = get_acc(tile, of.ACC, lane), get_acc(tile, of.NEXT_ACC, lane)
    turn = relative_rate(end.phi - y.phi, end.theta - y.theta, p)
    rate0, rate1 = relative_rate(y.dphi, y.dtheta, p), relative_rate(end.dphi, end.dtheta, p)
    accel0 = relative_rate(acc.ddphi, acc.ddtheta, p)
    accel1 = relative_rate(acc_end.ddphi, acc_end.ddtheta, p)
    lost = get_losses(tile, of.LOST, lane).copper
    power0, change0 = _copper_rates(rate0, accel0, u, p)
    power1, change1 = _copper_rates(rate1, accel1, u, p)
    return _Course(
        quintic(0.0, rate0, accel0, turn, rate1, accel1, h),
        quintic(0.0, power0, change0, lost, power1, change1, h),
        rate0,
        rate1,
    )


@inlined
def _work_until(s, course, u, h, p):
    """Electrical and shaft work of the first part of a step."""
    electrical = u * motor_charge(value(course.turn, s), u, h * s, p)
    return electrical, electrical - value(course.copper, s)


@vectorised
def split_at_current(tile):
    """Split the work of a step where the current, and so V i and T psi', changes sign.

    There the integrand is zero: two Newton steps from the secant leave an error below rounding.
    """
    for lane in range(LANES):
        u, h, p = tile[of.VOLTAGE + lane], tile[of.STEP + lane], machine(tile, lane)
        course = _course(tile, lane, u, h, p)
        electrical, work = _work_until(_crossing(course, u / p.K, h), course, u, h, p)
        if tile[of.FLAG + lane] == of.CURRENT:
            rest = tile[of.WORK_ELECTRICAL + lane] - electrical
            tile[of.WORK_POSITIVE + lane] = max(electrical, 0.0) + max(rest, 0.0)
            tile[of.WORK_SHAFT + lane] = abs(work) + abs(_all_work(tile, lane) - work)


@vectorised
def split_work(tile):
    """Split the work of a step wherever V i or T psi' changes sign."""
    for lane in range(LANES):
        u, h, p = tile[of.VOLTAGE + lane], tile[of.STEP + lane], machine(tile, lane)
        course = _course(tile, lane, u, h, p)
        s_current = _crossing(course, u / p.K if p.K > 0.0 else np.inf, h)
        s_rate = _crossing(course, 0.0, h)
        part, _ = _work_until(s_current, course, u, h, p)
        _, work0 = _work_until(min(s_current, s_rate), course, u, h, p)
        _, work1 = _work_until(max(s_current, s_rate), course, u, h, p)
        if tile[of.FLAG + lane] == of.SPLIT:
            rest, work = tile[of.WORK_ELECTRICAL + lane] - part, _all_work(tile, lane)
            tile[of.WORK_POSITIVE + lane] = max(part, 0.0) + max(rest, 0.0)
            tile[of.WORK_SHAFT + lane] = abs(work0) + abs(work1 - work0) + abs(work - work1)


@inlined
def _all_work(tile, lane):
    """The shaft's work over the whole attempt, with its sign."""
    return tile[of.WORK_ELECTRICAL + lane] - get_losses(tile, of.LOST, lane).copper


@inlined
def _crossing(course, level, h):
    """Fraction of a step at which psi' crosses a level; 1 where it does not."""
    s = (level - course.rate) / (course.rate_end - course.rate)
    rate = derivative(course.turn)
    for _ in range(2):
        newton = s - (value(rate, s) - level * h) / slope(rate, s)
        s = min(max(newton, 0.0), 1.0)
    return s if (course.rate - level) * (course.rate_end - level) < 0.0 else 1.0
