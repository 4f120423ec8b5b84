"""Booking a step's energies and extremes into the rows of `rimless_gym.energy`.

With V held, the electrical integrals are exact in the step's own solution:
integral of V i = V (V t - K delta psi) / Rm, and the others need only Q, the integral of psi'^2.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rimless_gym import energy as row
from rimless_gym.hybrid import (
    CONTACT_LOST,
    DOUBLE,
    MAX_RATE,
    OK,
    accelerations,
    ground_reaction,
    hub_position,
    inlined,
    linear_momentum,
    mechanical_energy,
    pendulum_clearance,
    relative_rate,
)
from rimless_gym.interpolation import derivative, quintic, slope, value
from rimless_gym.tile import (
    ACC,
    ATTEMPT,
    BOOKED,
    BRAKED,
    CLEARANCE,
    CUT,
    DEMAND,
    ENERGY,
    ENERGY_BEFORE,
    EVENTS,
    FAILURE,
    FLAG,
    FOOT,
    FOOT_BEFORE,
    FORCE_X,
    FORCE_Y,
    GOAL,
    HUB,
    HUB_BEFORE,
    LANES,
    LEFT,
    LOW,
    MODE,
    NEXT,
    NEXT_ACC,
    NEXT_ENERGY,
    NEXT_HUB,
    STATE,
    STEP,
    TRIES,
    TURNED,
    VOLTAGE,
    WORK_COPPER,
    WORK_DRAG,
    WORK_ELECTRICAL,
    WORK_FRICTION,
    WORK_POSITIVE,
    WORK_SHAFT,
    get_pair,
    get_state,
    machine,
    put_pair,
    put_state,
)

_vectorised = njit(error_model="numpy", fastmath={"contract"})

#: Steps are so short that between their ends the ground reaction dips by no more than a quarter of
#: this share of what the motion adds to it.
DIP = 0.02

#: What is to be done about a lane's attempt: nothing; to split its work where the current changes
#: sign; where the current or psi' does; to judge it.
PLAIN, CURRENT, SPLIT, FLAGGED = 0.0, 1.0, 2.0, 3.0


@inlined
def _contact(y, acc, p):
    """(Fx, Fy, friction demand, the pendulum's clearance)."""
    fx, fy = ground_reaction(y[0], y[1], y[2], y[3], acc[0], acc[1], p)
    demand = abs(fx) / fy
    return fx, fy, demand if fy > 0.0 else np.inf, pendulum_clearance(y[0], y[1], p)


@inlined
def book(tile, quantity, lane, amount):
    """Add to one of the booked rows."""
    tile[BOOKED + quantity * LANES + lane] += amount


@_vectorised
def open_interval(tile, duration, pull):
    """Begin a control interval of all lanes: nothing booked, no event under way."""
    for lane in range(LANES):
        y, mode, u = get_state(tile, STATE, lane), tile[MODE + lane], tile[VOLTAGE + lane]
        p = machine(tile, lane)
        acc = accelerations(mode, y[0], y[1], y[2], y[3], u, p)
        fx, fy, demand, clearance = _contact(y, acc, p)
        energy, hub = mechanical_energy(y[0], y[1], y[2], y[3], p), hub_position(y[0], p)[0]
        put_pair(tile, ACC, lane, acc)
        tile[ENERGY + lane] = energy
        tile[ENERGY_BEFORE + lane] = energy
        tile[HUB + lane] = hub
        tile[HUB_BEFORE + lane] = hub
        tile[FOOT_BEFORE + lane] = tile[FOOT + lane]
        tile[BOOKED + row.MIN_NORMAL_FORCE * LANES + lane] = fy
        tile[BOOKED + row.FRICTION_DEMAND * LANES + lane] = demand
        tile[BOOKED + row.CLEARANCE * LANES + lane] = clearance
        tile[BOOKED + row.FORCE_X * LANES + lane] = fx
        tile[BOOKED + row.FORCE_Y * LANES + lane] = fy
        tile[FAILURE + lane] = CONTACT_LOST if -pull - fy > 0.0 else OK
        tile[LEFT + lane] = duration
        tile[EVENTS + lane] = 0.0
        tile[BOOKED + row.TOUCHDOWN_TIME * LANES + lane] = -1.0
        tile[BOOKED + row.TOUCHDOWNS * LANES + lane] = 0.0
        tile[BOOKED + row.IMPULSE_FRICTION_DEMAND * LANES + lane] = 0.0
        tile[BOOKED + row.COLLISION * LANES + lane] = 0.0
        tile[BOOKED + row.ELECTRICAL * LANES + lane] = 0.0
        tile[BOOKED + row.ELECTRICAL_POSITIVE * LANES + lane] = 0.0
        tile[BOOKED + row.COPPER * LANES + lane] = 0.0
        tile[BOOKED + row.FRICTION * LANES + lane] = 0.0
        tile[BOOKED + row.DRAG * LANES + lane] = 0.0
        tile[BOOKED + row.SHAFT * LANES + lane] = 0.0
        clear_attempt(tile, lane)


@inlined
def close(tile, lane, duration):
    """Book what the interval as a whole amounts to so far."""
    p = machine(tile, lane)
    steps = tile[FOOT + lane] - tile[FOOT_BEFORE + lane]
    travel = tile[HUB + lane] - tile[HUB_BEFORE + lane] + steps * p.chord
    change = tile[ENERGY + lane] - tile[ENERGY_BEFORE + lane]
    descent = (p.m1 + p.m2) * p.gx * p.chord
    tile[BOOKED + row.TIME * LANES + lane] = duration - tile[LEFT + lane]
    tile[BOOKED + row.DISTANCE * LANES + lane] = travel
    tile[BOOKED + row.STEPS * LANES + lane] = steps
    tile[BOOKED + row.MECHANICAL_CHANGE * LANES + lane] = change - steps * descent
    tile[BOOKED + row.FAILURE * LANES + lane] = tile[FAILURE + lane]


@inlined
def clear_attempt(tile, lane):
    """Nothing tried yet of the next step."""
    tile[ATTEMPT + lane] = -1.0
    tile[GOAL + lane] = 0.0
    tile[LOW + lane] = 0.0
    tile[TRIES + lane] = 0.0
    tile[CUT + lane] = 0.0


@_vectorised
def measure(tile, pull):
    """Forces, energies and work of the attempted step; which lanes need more than the common case.

    Returns in how many lanes psi' changes sign, and how many `rimless_gym.events` has to judge.
    """
    split = flagged = 0
    for lane in range(LANES):
        y, end = get_state(tile, STATE, lane), get_state(tile, NEXT, lane)
        mode, u, h = tile[MODE + lane], tile[VOLTAGE + lane], tile[STEP + lane]
        p, acc = machine(tile, lane), get_pair(tile, ACC, lane)
        acc_end = accelerations(mode, end[0], end[1], end[2], end[3], u, p)
        fx, fy, demand, clearance = _contact(end, acc_end, p)
        put_pair(tile, NEXT_ACC, lane, acc_end)
        tile[FORCE_X + lane] = fx
        tile[FORCE_Y + lane] = fy
        tile[DEMAND + lane] = demand
        tile[CLEARANCE + lane] = clearance
        tile[NEXT_ENERGY + lane] = mechanical_energy(end[0], end[1], end[2], end[3], p)
        tile[NEXT_HUB + lane] = hub_position(end[0], p)[0]

        turn, q = relative_rate(end[0] - y[0], end[1] - y[1], p), tile[TURNED + lane]
        rate, rate_end = relative_rate(y[2], y[3], p), relative_rate(end[2], end[3], p)
        electrical, shaft = u * (u * h - p.K * turn) * p.G, p.K * (u * turn - p.K * q) * p.G
        tile[WORK_ELECTRICAL + lane] = electrical
        tile[WORK_POSITIVE + lane] = max(electrical, 0.0)
        tile[WORK_COPPER + lane] = (u * u * h - 2 * u * p.K * turn + p.K * p.K * q) * p.G
        tile[WORK_FRICTION + lane] = p.damping * q
        tile[WORK_DRAG + lane] = tile[BRAKED + lane]
        tile[WORK_SHAFT + lane] = abs(shaft)

        reach = 0.5 * h * max(abs(y[2]), abs(end[2]))
        near = max(y[0], end[0]) + reach >= p.b or min(y[0], end[0]) - reach <= p.a
        swing = y[3] * y[3] + end[3] * end[3] + abs(acc[1]) + abs(acc_end[1])
        roll = y[2] * y[2] + end[2] * end[2] + abs(acc[0]) + abs(acc_end[0])
        pressed = min(fy, tile[BOOKED + row.FORCE_Y * LANES + lane]) + pull
        light = pressed < DIP * (p.S2 * swing + p.S1 * roll)
        kink = p.Cd > 0.0 and y[2] * end[2] < 0.0
        sane = max(abs(end[2]), abs(end[3])) < 10 * MAX_RATE
        common = sane and not (near or light or kink or mode == DOUBLE)
        common = common and tile[GOAL + lane] == 0.0
        waits = tile[LEFT + lane] <= 0.0 or tile[FAILURE + lane] != OK
        flips = CURRENT if (u - p.K * rate) * (u - p.K * rate_end) < 0.0 else PLAIN
        flips = SPLIT if rate * rate_end < 0.0 else flips
        flag = flips if common or waits else FLAGGED
        tile[FLAG + lane] = flag
        split += 1 if flag == SPLIT else 0
        flagged += 1 if flag == FLAGGED else 0
    return split, flagged


@inlined
def _relative_motion(tile, lane, p):
    """Quintics of psi and of the integral of psi'^2 over the attempt, and psi' at its ends."""
    y, end, h = get_state(tile, STATE, lane), get_state(tile, NEXT, lane), tile[STEP + lane]
    acc, acc_end = get_pair(tile, ACC, lane), get_pair(tile, NEXT_ACC, lane)
    turn, q = relative_rate(end[0] - y[0], end[1] - y[1], p), tile[TURNED + lane]
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


@_vectorised
def split_at_current(tile):
    """Split the work of a step where the current, and so V i and T psi', changes sign.

    There the integrand is zero: two Newton steps from the secant leave an error below rounding.
    """
    for lane in range(LANES):
        u, h, p = tile[VOLTAGE + lane], tile[STEP + lane], machine(tile, lane)
        angle, square, rate0, rate1 = _relative_motion(tile, lane, p)
        s = _crossing(rate0, rate1, u / p.K, angle, h)
        electrical, work = _work_until(s, angle, square, u, h, p)
        if tile[FLAG + lane] == CURRENT:
            rest = tile[WORK_ELECTRICAL + lane] - electrical
            tile[WORK_POSITIVE + lane] = max(electrical, 0.0) + max(rest, 0.0)
            all_work = tile[WORK_ELECTRICAL + lane] - tile[WORK_COPPER + lane]
            tile[WORK_SHAFT + lane] = abs(work) + abs(all_work - work)


@_vectorised
def split_work(tile):
    """Split the work of a step wherever V i or T psi' changes sign."""
    for lane in range(LANES):
        u, h, p = tile[VOLTAGE + lane], tile[STEP + lane], machine(tile, lane)
        angle, square, rate0, rate1 = _relative_motion(tile, lane, p)
        s_current = _crossing(rate0, rate1, u / p.K if p.K > 0.0 else np.inf, angle, h)
        s_rate = _crossing(rate0, rate1, 0.0, angle, h)
        part, _ = _work_until(s_current, angle, square, u, h, p)
        _, work0 = _work_until(min(s_current, s_rate), angle, square, u, h, p)
        _, work1 = _work_until(max(s_current, s_rate), angle, square, u, h, p)
        if tile[FLAG + lane] == SPLIT:
            rest = tile[WORK_ELECTRICAL + lane] - part
            work = tile[WORK_ELECTRICAL + lane] - tile[WORK_COPPER + lane]
            tile[WORK_POSITIVE + lane] = max(part, 0.0) + max(rest, 0.0)
            tile[WORK_SHAFT + lane] = abs(work0) + abs(work1 - work0) + abs(work - work1)


@inlined
def _crossing(rate0, rate1, level, angle, h):
    """Fraction of a step at which psi' crosses a level; 1 where it does not."""
    s = (level - rate0) / (rate1 - rate0)
    rate = derivative(angle)
    for _ in range(2):
        newton = s - (value(rate, s) - level * h) / slope(rate, s)
        s = min(max(newton, 0.0), 1.0)
    return s if (rate0 - level) * (rate1 - level) < 0.0 else 1.0


@_vectorised
def accept(tile, duration):
    """Take the attempted step in all lanes that are not flagged any more.

    Returns how many lanes are not done.
    """
    unfinished = 0
    for lane in range(LANES):
        if tile[FLAG + lane] != FLAGGED:
            h = tile[STEP + lane]
            put_state(tile, STATE, lane, get_state(tile, NEXT, lane))
            put_pair(tile, ACC, lane, get_pair(tile, NEXT_ACC, lane))
            tile[ENERGY + lane] = tile[NEXT_ENERGY + lane]
            tile[HUB + lane] = tile[NEXT_HUB + lane]
            tile[LEFT + lane] = tile[LEFT + lane] - h
            tile[BOOKED + row.FORCE_X * LANES + lane] = tile[FORCE_X + lane]
            tile[BOOKED + row.FORCE_Y * LANES + lane] = tile[FORCE_Y + lane]
            _extreme(tile, lane, tile[FORCE_Y + lane], tile[DEMAND + lane])
            lowest = min(tile[BOOKED + row.CLEARANCE * LANES + lane], tile[CLEARANCE + lane])
            tile[BOOKED + row.CLEARANCE * LANES + lane] = lowest
            book(tile, row.ELECTRICAL, lane, tile[WORK_ELECTRICAL + lane])
            book(tile, row.ELECTRICAL_POSITIVE, lane, tile[WORK_POSITIVE + lane])
            book(tile, row.COPPER, lane, tile[WORK_COPPER + lane])
            book(tile, row.FRICTION, lane, tile[WORK_FRICTION + lane])
            book(tile, row.DRAG, lane, tile[WORK_DRAG + lane])
            book(tile, row.SHAFT, lane, tile[WORK_SHAFT + lane])
            tile[ATTEMPT + lane] = -1.0
        close(tile, lane, duration)
        runs = tile[LEFT + lane] > 0.0 and tile[FAILURE + lane] == OK
        unfinished += 1 if runs else 0
    return unfinished


@inlined
def _extreme(tile, lane, fy, demand):
    least = min(tile[BOOKED + row.MIN_NORMAL_FORCE * LANES + lane], fy)
    most = max(tile[BOOKED + row.FRICTION_DEMAND * LANES + lane], demand)
    tile[BOOKED + row.MIN_NORMAL_FORCE * LANES + lane] = least
    tile[BOOKED + row.FRICTION_DEMAND * LANES + lane] = most


@njit(error_model="numpy")
def restart(tile, lane, mode, foot, y):
    """Put a lane into another mode or onto another leg, and book the contact forces there."""
    u, p = tile[VOLTAGE + lane], machine(tile, lane)
    acc = accelerations(mode, y[0], y[1], y[2], y[3], u, p)
    fx, fy, demand, clearance = _contact(y, acc, p)
    tile[MODE + lane] = mode
    tile[FOOT + lane] = foot
    put_state(tile, STATE, lane, y)
    put_pair(tile, ACC, lane, acc)
    tile[ENERGY + lane] = mechanical_energy(y[0], y[1], y[2], y[3], p)
    tile[HUB + lane] = hub_position(y[0], p)[0]
    tile[BOOKED + row.FORCE_X * LANES + lane] = fx
    tile[BOOKED + row.FORCE_Y * LANES + lane] = fy
    _extreme(tile, lane, fy, demand)
    lowest = min(tile[BOOKED + row.CLEARANCE * LANES + lane], clearance)
    tile[BOOKED + row.CLEARANCE * LANES + lane] = lowest
    tile[EVENTS + lane] = tile[EVENTS + lane] + 1
    return fy


@njit(error_model="numpy")
def book_touchdown(tile, lane, y0, y1, shift, time):
    """Add a touchdown's loss, and the friction that its impulse demands."""
    p = machine(tile, lane)
    descent = (p.m1 + p.m2) * p.gx * p.chord
    before = mechanical_energy(y0[0], y0[1], y0[2], y0[3], p)
    after = mechanical_energy(y1[0], y1[1], y1[2], y1[3], p) - shift * descent
    book(tile, row.COLLISION, lane, before - after)
    book(tile, row.TOUCHDOWNS, lane, 1.0)
    x0, z0 = linear_momentum(y0[0], y0[1], y0[2], y0[3], p)
    x1, z1 = linear_momentum(y1[0], y1[1], y1[2], y1[3], p)
    demand = abs(x1 - x0) / (z1 - z0) if z1 > z0 else np.inf
    most = max(tile[BOOKED + row.IMPULSE_FRICTION_DEMAND * LANES + lane], demand)
    tile[BOOKED + row.IMPULSE_FRICTION_DEMAND * LANES + lane] = most
    tile[BOOKED + row.TOUCHDOWN_TIME * LANES + lane] = time
