"""Accumulating a step's energies and extremes in the rows of `rimless_gym.energy`.

The losses are integrated along with the motion. With V held, the electrical energy is V times the
charge, which is exact for the step's own solution. The shaft's work is the electrical energy less
the copper loss.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.equations import DOUBLE, LOSSES
from rimless_gym.hybrid import (
    CONTACT_LOST,
    MAX_RATE,
    OK,
    accelerations_turned,
    both_feet_press,
    contact_guard,
    crosses_kink,
    descent,
    foot_travel,
    friction_demand,
    linear_momentum,
    losses,
    mechanical_energy,
    motor_charge,
    motor_current,
    relative_rate,
    touchdown_guard,
    turned,
)
from rimless_gym.jit import inlined, inner, vectorised
from rimless_gym.kernel import tile as slot
from rimless_gym.kernel.integration import derivative, quintic, slope, value
from rimless_gym.kernel.tile import (
    LANES,
    adder,
    constants,
    get_acc,
    get_ground,
    get_losses,
    get_state,
    one_copy,
    put_acc,
    put_losses,
    put_state,
    turned_angles,
    unturned_angles,
)
from rimless_gym.streams import ground_turn
from rimless_gym.trigonometry import MAX_TURN

#: Steps are so short that between their ends the ground reaction dips by no more than a quarter of
#: this share of what the motion adds to it.
DIP = 0.02

_ground_reaction, _pendulum_clearance = turned.ground_reaction, turned.pendulum_clearance
_mechanical_energy, _hub_position = turned.mechanical_energy, turned.hub_position


@inlined
def _evaluate(tile, lane, angles, dphi, dtheta):
    """A state's accelerations, contact (Fx, Fy, friction demand, clearance), energy and hub's x."""
    (phi, theta), p = angles, constants(tile, lane)
    mode, u = tile[slot.MODE + lane], tile[slot.VOLTAGE + lane]
    acc = accelerations_turned(mode, phi, theta, dphi, dtheta, u, p)
    fx, fy = _ground_reaction(phi, theta, dphi, dtheta, acc[0], acc[1], p)
    contact = fx, fy, friction_demand(fx, fy), _pendulum_clearance(phi, theta, p)
    energy = _mechanical_energy(phi, theta, dphi, dtheta, p)
    return acc, contact, energy, _hub_position(phi, p)[0]


@inlined
def total(tile, row, lane):
    """One of the interval's totals, a row of `rimless_gym.energy.ROW`."""
    return tile[slot.TOTALS + row * LANES + lane]


@inlined
def set_total(tile, row, lane, value):
    """Set one of the totals."""
    tile[slot.TOTALS + row * LANES + lane] = value


@inlined
def accumulate(tile, row, lane, amount):
    """Add to one of the totals."""
    tile[slot.TOTALS + row * LANES + lane] += amount


_LOSS_TOTALS = slot.TOTALS + getattr(ROW, next(iter(LOSSES))) * LANES  # they are side by side
_add_losses = adder(len(LOSSES))
_no_losses = (0.0,) * len(LOSSES)


@vectorised
def open_interval(tile, duration, pull):
    """Begin a control interval in all lanes: totals of zero, no event under way."""
    for lane in range(LANES):
        y, here = get_state(tile, slot.STATE, lane), unturned_angles(tile, lane)
        acc, contact, energy, hub = _evaluate(tile, lane, here, y.dphi, y.dtheta)
        fx, fy, demand, clearance = contact
        put_acc(tile, slot.ACC, lane, acc)
        tile[slot.ENERGY + lane] = energy
        tile[slot.ENERGY_BEFORE + lane] = energy
        tile[slot.HUB + lane] = hub
        tile[slot.HUB_BEFORE + lane] = hub
        tile[slot.FOOT_BEFORE + lane] = tile[slot.FOOT + lane]
        tile[slot.FOOT_TRAVEL + lane] = 0.0
        tile[slot.FOOT_DESCENT + lane] = 0.0
        set_total(tile, ROW.min_normal_force, lane, fy)
        set_total(tile, ROW.friction_demand, lane, demand)
        set_total(tile, ROW.clearance, lane, clearance)
        set_total(tile, ROW.force_x, lane, fx)
        set_total(tile, ROW.force_y, lane, fy)
        tile[slot.FAILURE + lane] = CONTACT_LOST if contact_guard(fy, pull) > 0.0 else OK
        tile[slot.LEFT + lane] = duration
        tile[slot.EVENTS + lane] = 0.0
        set_total(tile, ROW.touchdown_time, lane, -1.0)
        set_total(tile, ROW.touchdowns, lane, 0.0)
        set_total(tile, ROW.impulse_friction_demand, lane, 0.0)
        set_total(tile, ROW.collision, lane, 0.0)
        set_total(tile, ROW.electrical, lane, 0.0)
        set_total(tile, ROW.electrical_positive, lane, 0.0)
        put_losses(tile, _LOSS_TOTALS, lane, _no_losses)
        set_total(tile, ROW.shaft, lane, 0.0)
        clear_attempt(tile, lane)


@inlined
def close(tile, lane, duration):
    """Complete the totals of the interval so far."""
    steps = tile[slot.FOOT + lane] - tile[slot.FOOT_BEFORE + lane]
    travel = tile[slot.HUB + lane] - tile[slot.HUB_BEFORE + lane] + tile[slot.FOOT_TRAVEL + lane]
    change = tile[slot.ENERGY + lane] - tile[slot.ENERGY_BEFORE + lane]
    set_total(tile, ROW.elapsed, lane, duration - tile[slot.LEFT + lane])
    set_total(tile, ROW.distance, lane, travel)
    set_total(tile, ROW.steps, lane, steps)
    set_total(tile, ROW.mechanical_change, lane, change - tile[slot.FOOT_DESCENT + lane])
    set_total(tile, ROW.failure, lane, tile[slot.FAILURE + lane])


@inlined
def clear_attempt(tile, lane):
    """Forget the attempts at the last step."""
    tile[slot.ATTEMPT + lane] = -1.0
    tile[slot.GOAL + lane] = 0.0
    tile[slot.LOW + lane] = 0.0
    tile[slot.TRIES + lane] = 0.0
    tile[slot.CUT + lane] = 0.0


@vectorised
def measure(tile, pull):
    """Find forces, energies and work of the attempted step, and flag what is left to do about it.

    Returns how many lanes are marked `CURRENT`, `SPLIT` and `FLAGGED` (`rimless_gym.kernel.tile`).
    """
    current = split = flagged = 0
    for lane in range(LANES):
        y, end = get_state(tile, slot.STATE, lane), get_state(tile, slot.NEXT, lane)
        mode, u, h = tile[slot.MODE + lane], tile[slot.VOLTAGE + lane], tile[slot.STEP + lane]
        p, acc = constants(tile, lane), get_acc(tile, slot.ACC, lane)
        there = turned_angles(tile, lane, end.phi - y.phi, end.theta - y.theta)
        acc_end, contact, energy, hub = _evaluate(tile, lane, there, end.dphi, end.dtheta)
        fx, fy, demand, clearance = contact
        put_acc(tile, slot.NEXT_ACC, lane, acc_end)
        tile[slot.FORCE_X + lane] = fx
        tile[slot.FORCE_Y + lane] = fy
        tile[slot.DEMAND + lane] = demand
        tile[slot.CLEARANCE + lane] = clearance
        tile[slot.NEXT_ENERGY + lane] = energy
        tile[slot.NEXT_HUB + lane] = hub

        turn = relative_rate(end.phi - y.phi, end.theta - y.theta, p)
        electrical = u * motor_charge(turn, u, h, p)
        tile[slot.WORK_ELECTRICAL + lane] = electrical
        tile[slot.WORK_POSITIVE + lane] = max(electrical, 0.0)
        tile[slot.WORK_SHAFT + lane] = abs(electrical - get_losses(tile, slot.LOST, lane).copper)

        reach = 0.5 * h * max(abs(y.dphi), abs(end.dphi))
        near = touchdown_guard(1, max(y.phi, end.phi) + reach, p) >= 0.0
        near = near or touchdown_guard(-1, min(y.phi, end.phi) - reach, p) >= 0.0
        near = tile[slot.FOOT_PULL + lane] > 0.0 if mode == DOUBLE else near
        swing = y.dtheta * y.dtheta + end.dtheta * end.dtheta + abs(acc.ddtheta)
        swing += abs(acc_end.ddtheta)
        roll = y.dphi * y.dphi + end.dphi * end.dphi + abs(acc.ddphi) + abs(acc_end.ddphi)
        pressed = min(fy, total(tile, ROW.force_y, lane)) + pull
        light = pressed < DIP * (p.S2 * swing + p.S1 * roll)
        kink = crosses_kink(y.dphi, end.dphi, p)
        sane = max(abs(end.dphi), abs(end.dtheta)) <= MAX_RATE
        sane = sane and tile[slot.FAR + lane] <= MAX_TURN * MAX_TURN
        common = sane and not (near or light or kink)
        common = common and tile[slot.GOAL + lane] == 0.0 and tile[slot.CUT + lane] == 0.0
        waits = tile[slot.LEFT + lane] <= 0.0 or tile[slot.FAILURE + lane] != OK
        rate, rate_end = relative_rate(y.dphi, y.dtheta, p), relative_rate(end.dphi, end.dtheta, p)
        i, i_end = motor_current(rate, u, p), motor_current(rate_end, u, p)
        flips = slot.CURRENT if i * i_end < 0.0 else slot.PLAIN
        flips = slot.SPLIT if rate * rate_end < 0.0 else flips
        ddpsi = relative_rate(acc.ddphi, acc.ddtheta, p)
        ddpsi_end = relative_rate(acc_end.ddphi, acc_end.ddtheta, p)
        beyond = h * max(abs(ddpsi), abs(ddpsi_end))  # psi' goes no further beyond its ends
        close = min(abs(rate), abs(rate_end)) < beyond
        close = close or min(abs(i), abs(i_end)) < p.K * p.G * beyond
        flips = slot.SPLIT if ddpsi * ddpsi_end < 0.0 and close else flips
        flag = flips if common else slot.FLAGGED
        flag = slot.IDLE if waits else flag
        tile[slot.FLAG + lane] = flag
        current += 1 if flag == slot.CURRENT else 0
        split += 1 if flag == slot.SPLIT else 0
        flagged += 1 if flag == slot.FLAGGED else 0
    return current, split, flagged


@vectorised
def accept(tile, duration):
    """Accept the attempted step in all lanes that made one and are no longer flagged.

    Returns how many lanes are not done.
    """
    unfinished = 0
    for lane in range(LANES):
        tile[slot.EVENT + lane] = 0.0
        if tile[slot.FLAG + lane] < slot.FLAGGED:
            h = tile[slot.STEP + lane]
            put_state(tile, slot.STATE, lane, get_state(tile, slot.NEXT, lane))
            put_acc(tile, slot.ACC, lane, get_acc(tile, slot.NEXT_ACC, lane))
            tile[slot.ENERGY + lane] = tile[slot.NEXT_ENERGY + lane]
            tile[slot.HUB + lane] = tile[slot.NEXT_HUB + lane]
            tile[slot.LEFT + lane] = tile[slot.LEFT + lane] - h
            set_total(tile, ROW.force_x, lane, tile[slot.FORCE_X + lane])
            set_total(tile, ROW.force_y, lane, tile[slot.FORCE_Y + lane])
            _extreme(tile, lane, tile[slot.FORCE_Y + lane], tile[slot.DEMAND + lane])
            lowest = min(total(tile, ROW.clearance, lane), tile[slot.CLEARANCE + lane])
            set_total(tile, ROW.clearance, lane, lowest)
            accumulate(tile, ROW.electrical, lane, tile[slot.WORK_ELECTRICAL + lane])
            accumulate(tile, ROW.electrical_positive, lane, tile[slot.WORK_POSITIVE + lane])
            _add_losses(tile, _LOSS_TOTALS, lane, 1.0, get_losses(tile, slot.LOST, lane))
            accumulate(tile, ROW.shaft, lane, tile[slot.WORK_SHAFT + lane])
            tile[slot.EVENT + lane] = tile[slot.GOAL + lane]
            clear_attempt(tile, lane)
        close(tile, lane, duration)
        runs = tile[slot.LEFT + lane] > 0.0 and tile[slot.FAILURE + lane] == OK
        unfinished += 1 if runs else 0
    return unfinished


@inlined
def _extreme(tile, lane, fy, demand):
    least = min(total(tile, ROW.min_normal_force, lane), fy)
    most = max(total(tile, ROW.friction_demand, lane), demand)
    set_total(tile, ROW.min_normal_force, lane, least)
    set_total(tile, ROW.friction_demand, lane, most)


@inner
def forget_extremes(tile, lane):
    """Forget the extremes of the contact forces."""
    set_total(tile, ROW.min_normal_force, lane, np.inf)
    set_total(tile, ROW.friction_demand, lane, 0.0)


@inner
def find_ground(tile, lane):
    """Find how the ground turns behind and ahead of the foot; on two feet, it is that between."""
    one_copy()
    ground, foot = get_ground(tile, slot.GROUND, lane), np.int64(tile[slot.FOOT + lane])
    alpha = constants(tile, lane).alpha
    behind = ground_turn(ground, foot - 1, alpha)
    stands = tile[slot.MODE + lane] == DOUBLE
    tile[slot.BEHIND + lane] = behind
    tile[slot.AHEAD + lane] = behind if stands else ground_turn(ground, foot, alpha)


@inner
def restart(tile, lane, mode, foot, y, pull):
    """Put a lane into another mode or onto another leg, with the contact forces there.

    If one of two feet lifts off at once, the wheel never stood on both, so the forces do not count
    as extremes. Returns the normal force (N).
    """
    shift, turn, p = foot - tile[slot.FOOT + lane], tile[slot.BEHIND + lane], constants(tile, lane)
    tile[slot.FOOT_TRAVEL + lane] += shift * foot_travel(turn, p)
    tile[slot.FOOT_DESCENT + lane] += shift * descent(turn, p)
    tile[slot.MODE + lane] = mode
    tile[slot.FOOT + lane] = foot
    find_ground(tile, lane)
    put_state(tile, slot.STATE, lane, y)
    here, p = unturned_angles(tile, lane), constants(tile, lane)
    acc, contact, energy, hub = _evaluate(tile, lane, here, y.dphi, y.dtheta)
    fx, fy, demand, clearance = contact
    put_acc(tile, slot.ACC, lane, acc)
    tile[slot.ENERGY + lane] = energy
    tile[slot.HUB + lane] = hub
    set_total(tile, ROW.force_x, lane, fx)
    set_total(tile, ROW.force_y, lane, fy)
    u = tile[slot.VOLTAGE + lane]
    lets_go = mode == DOUBLE and not both_feet_press(y.theta, y.dtheta, u, p)
    if not lets_go or contact_guard(fy, pull) > 0.0:
        _extreme(tile, lane, fy, demand)
    lowest = min(total(tile, ROW.clearance, lane), clearance)
    set_total(tile, ROW.clearance, lane, lowest)
    tile[slot.EVENTS + lane] = tile[slot.EVENTS + lane] + 1
    return fy


@inner
def add_touchdown(tile, lane, y0, y1, shift, time):
    """Add a touchdown's loss, and the friction that its impulse demands."""
    p, turn = constants(tile, lane), tile[slot.BEHIND + lane]
    before = mechanical_energy(y0.phi, y0.theta, y0.dphi, y0.dtheta, p)
    after = mechanical_energy(y1.phi, y1.theta, y1.dphi, y1.dtheta, p) - shift * descent(turn, p)
    accumulate(tile, ROW.collision, lane, before - after)
    accumulate(tile, ROW.touchdowns, lane, 1.0)
    x0, z0 = linear_momentum(y0.phi, y0.theta, y0.dphi, y0.dtheta, p)
    x1, z1 = linear_momentum(y1.phi, y1.theta, y1.dphi, y1.dtheta, p)
    most = max(total(tile, ROW.impulse_friction_demand, lane), friction_demand(x1 - x0, z1 - z0))
    set_total(tile, ROW.impulse_friction_demand, lane, most)
    set_total(tile, ROW.touchdown_time, lane, time)


# -- Work of a step in which V i or T psi' changes sign, split there -------------------------------
#
# The ledger's max(V i, 0) and |T psi'| need this. With V held, the current changes sign where psi'
# is V / K. The shaft's power changes sign there, and where psi' does. Within a step psi' may pass a
# level twice, before and after its peak.


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
    y, end = get_state(tile, slot.STATE, lane), get_state(tile, slot.NEXT, lane)
    acc, acc_end = get_acc(tile, slot.ACC, lane), get_acc(tile, slot.NEXT_ACC, lane)
    turn = relative_rate(end.phi - y.phi, end.theta - y.theta, p)
    rate0, rate1 = relative_rate(y.dphi, y.dtheta, p), relative_rate(end.dphi, end.dtheta, p)
    accel0 = relative_rate(acc.ddphi, acc.ddtheta, p)
    accel1 = relative_rate(acc_end.ddphi, acc_end.ddtheta, p)
    lost = get_losses(tile, slot.LOST, lane).copper
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
        u, h, p = tile[slot.VOLTAGE + lane], tile[slot.STEP + lane], constants(tile, lane)
        course = _course(tile, lane, u, h, p)
        rate, start, end = derivative(course.turn), course.rate * h, course.rate_end * h
        level = u / p.K * h
        s = _passed(rate, level, (level - start) / (end - start), 0.0, 1.0)
        electrical, work = _work_until(s, course, u, h, p)
        if tile[slot.FLAG + lane] == slot.CURRENT:
            rest = tile[slot.WORK_ELECTRICAL + lane] - electrical
            tile[slot.WORK_POSITIVE + lane] = max(electrical, 0.0) + max(rest, 0.0)
            tile[slot.WORK_SHAFT + lane] = abs(work) + abs(_all_work(tile, lane) - work)


@vectorised
def split_work(tile):
    """Split the work of a step wherever V i or T psi' changes sign: each at most twice."""
    for lane in range(LANES):
        u, h, p = tile[slot.VOLTAGE + lane], tile[slot.STEP + lane], constants(tile, lane)
        course = _course(tile, lane, u, h, p)
        current0, current1 = _crossings(course, u / p.K if p.K > 0.0 else np.inf, h)
        rate0, rate1 = _crossings(course, 0.0, h)
        part0, _ = _work_until(current0, course, u, h, p)
        part1, _ = _work_until(current1, course, u, h, p)
        _, work0 = _work_until(min(current0, rate0), course, u, h, p)
        _, work1 = _work_until(max(current0, rate0), course, u, h, p)
        _, work2 = _work_until(min(current1, rate1), course, u, h, p)
        _, work3 = _work_until(max(current1, rate1), course, u, h, p)
        if tile[slot.FLAG + lane] == slot.SPLIT:
            rest, work = tile[slot.WORK_ELECTRICAL + lane] - part1, _all_work(tile, lane)
            positive = max(part0, 0.0) + max(part1 - part0, 0.0) + max(rest, 0.0)
            tile[slot.WORK_POSITIVE + lane] = positive
            shaft = abs(work0) + abs(work1 - work0) + abs(work2 - work1)
            tile[slot.WORK_SHAFT + lane] = shaft + abs(work3 - work2) + abs(work - work3)


@inlined
def _all_work(tile, lane):
    """The shaft's work over the whole attempt, with its sign."""
    return tile[slot.WORK_ELECTRICAL + lane] - get_losses(tile, slot.LOST, lane).copper


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
