"""The work of a step in which V i or T psi' changes sign, split there.

The ledger's max(V i, 0) and |T psi'| need this. With V held, the current changes sign where psi' is
V / K. The shaft's power changes sign there, and where psi' does. Within a step psi' may pass a
level twice, before and after its peak.
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
    """How the motor turns over an attempt.

    Attributes:
        turn: quintic of psi from its start.
        copper: quintic of the copper loss from the start (J).
        rate: psi' at the start.
        rate_end: psi' at the end.
        peak: fraction of the attempt at which psi'' changes sign; 1 if it does not.
    """

    turn: Any
    copper: Any
    rate: Any
    rate_end: Any
    peak: Any


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
    turning = quintic(0.0, rate0, accel0, turn, rate1, accel1, h)
    return _Course(
        turning,
        quintic(0.0, power0, change0, lost, power1, change1, h),
        rate0,
        rate1,
        _zero(derivative(derivative(turning)), accel0, accel1),
    )


@inlined
def _zero(c, begin, end):
    """Fraction of a step at which a polynomial with these signs at its ends is 0; or 1."""
    s = begin / (begin - end)
    for _ in range(2):
        s = min(max(s - value(c, s) / slope(c, s), 0.0), 1.0)
    return s if begin * end < 0.0 else 1.0


@inlined
def _work_until(s, course, u, h, p):
    """Electrical and shaft work of the first part of a step."""
    electrical = u * motor_charge(value(course.turn, s), u, h * s, p)
    return electrical, electrical - value(course.copper, s)


@vectorised
def split_at_current(tile):
    """Split the work of a step where the current, and so V i and T psi', changes sign once.

    There the integrand is zero: two Newton steps from the secant leave an error below rounding.
    """
    for lane in range(LANES):
        u, h, p = tile[of.VOLTAGE + lane], tile[of.STEP + lane], machine(tile, lane)
        course = _course(tile, lane, u, h, p)
        rate, start, end = derivative(course.turn), course.rate * h, course.rate_end * h
        level = u / p.K * h
        s = _passed(rate, level, (level - start) / (end - start), 0.0, 1.0)
        electrical, work = _work_until(s, course, u, h, p)
        if tile[of.FLAG + lane] == of.CURRENT:
            rest = tile[of.WORK_ELECTRICAL + lane] - electrical
            tile[of.WORK_POSITIVE + lane] = max(electrical, 0.0) + max(rest, 0.0)
            tile[of.WORK_SHAFT + lane] = abs(work) + abs(_all_work(tile, lane) - work)


@vectorised
def split_work(tile):
    """Split the work of a step wherever V i or T psi' changes sign: each at most twice."""
    for lane in range(LANES):
        u, h, p = tile[of.VOLTAGE + lane], tile[of.STEP + lane], machine(tile, lane)
        course = _course(tile, lane, u, h, p)
        current0, current1 = _crossings(course, u / p.K if p.K > 0.0 else np.inf, h)
        rate0, rate1 = _crossings(course, 0.0, h)
        part0, _ = _work_until(current0, course, u, h, p)
        part1, _ = _work_until(current1, course, u, h, p)
        _, work0 = _work_until(min(current0, rate0), course, u, h, p)
        _, work1 = _work_until(max(current0, rate0), course, u, h, p)
        _, work2 = _work_until(min(current1, rate1), course, u, h, p)
        _, work3 = _work_until(max(current1, rate1), course, u, h, p)
        if tile[of.FLAG + lane] == of.SPLIT:
            rest, work = tile[of.WORK_ELECTRICAL + lane] - part1, _all_work(tile, lane)
            positive = max(part0, 0.0) + max(part1 - part0, 0.0) + max(rest, 0.0)
            tile[of.WORK_POSITIVE + lane] = positive
            shaft = abs(work0) + abs(work1 - work0) + abs(work2 - work1)
            tile[of.WORK_SHAFT + lane] = shaft + abs(work3 - work2) + abs(work - work3)


@inlined
def _all_work(tile, lane):
    """The shaft's work over the whole attempt, with its sign."""
    return tile[of.WORK_ELECTRICAL + lane] - get_losses(tile, of.LOST, lane).copper


@inlined
def _crossings(course, level, h):
    """Fractions of a step at which psi' crosses a level, before its peak and after it.

    Where it does not, they are 0 and 1.
    """
    rate, peak, level_h = derivative(course.turn), course.peak, level * h
    start, top, end = course.rate * h, value(rate, peak), course.rate_end * h
    bend = slope(derivative(rate), peak)
    width = np.sqrt(abs(2 * (level_h - top) / bend))  # of a parabola about the peak
    secant = (level_h - start) / (end - start)
    before = _passed(rate, level_h, peak - width if peak < 1.0 else secant, 0.0, peak)
    after = _passed(rate, level_h, peak + width, peak, 1.0)
    return (
        before if (start - level_h) * (top - level_h) < 0.0 else 0.0,
        after if (end - level_h) * (top - level_h) < 0.0 else 1.0,
    )


@inlined
def _passed(rate, level, guess, low, high):
    """Where a polynomial has this value, from a guess by Newton's method within bounds."""
    s = min(max(guess, low), high)
    for _ in range(2):
        newton = s - (value(rate, s) - level) / slope(rate, s)
        s = min(max(newton, low), high)
    return s
