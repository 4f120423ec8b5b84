"""Booking a step's energies and extremes into the rows of `rimless_gym.energy`.

With V held, the electrical integrals are exact in the step's own solution:
integral of V i = V (V t - K delta psi) / Rm, and the others need only Q, the integral of psi'^2.
"""

from __future__ import annotations

import numpy as np

from rimless_gym import energy as row
from rimless_gym.hybrid import (
    CONTACT_LOST,
    DOUBLE,
    MAX_RATE,
    OK,
    accelerations_turned,
    both_feet_press,
    linear_momentum,
    mechanical_energy,
    relative_rate,
    turned,
)
from rimless_gym.jit import inlined, inner, vectorised
from rimless_gym.kernel import tile as of
from rimless_gym.kernel.tile import (
    LANES,
    get_pair,
    get_state,
    machine,
    put_pair,
    put_sines,
    put_state,
    turned_angles,
)
from rimless_gym.trigonometry import MAX_TURN

#: Steps are so short that between their ends the ground reaction dips by no more than a quarter of
#: this share of what the motion adds to it.
DIP = 0.02


_ground_reaction, _pendulum_clearance = turned.ground_reaction, turned.pendulum_clearance
_mechanical_energy, _hub_position = turned.mechanical_energy, turned.hub_position


@inlined
def _evaluate(tile, lane, angles, dphi, dtheta):
    """A state's accelerations, contact (Fx, Fy, friction demand, clearance), energy and hub's x."""
    (phi, theta), p = angles, machine(tile, lane)
    mode, u = tile[of.MODE + lane], tile[of.VOLTAGE + lane]
    acc = accelerations_turned(mode, phi, theta, dphi, dtheta, u, p)
    fx, fy = _ground_reaction(phi, theta, dphi, dtheta, acc[0], acc[1], p)
    demand = abs(fx) / fy
    contact = fx, fy, demand if fy > 0.0 else np.inf, _pendulum_clearance(phi, theta, p)
    energy = _mechanical_energy(phi, theta, dphi, dtheta, p)
    return acc, contact, energy, _hub_position(phi, p)[0]


@inlined
def book(tile, quantity, lane, amount):
    """Add to one of the booked rows."""
    tile[of.BOOKED + quantity * LANES + lane] += amount


@vectorised
def open_interval(tile, duration, pull):
    """Begin a control interval of all lanes: nothing booked, no event under way."""
    for lane in range(LANES):
        _, _, dphi, dtheta = get_state(tile, of.STATE, lane)
        put_sines(tile, lane)
        here = turned_angles(tile, lane, 0.0, 0.0)
        acc, (fx, fy, demand, clearance), energy, hub = _evaluate(tile, lane, here, dphi, dtheta)
        put_pair(tile, of.ACC, lane, acc)
        tile[of.ENERGY + lane] = energy
        tile[of.ENERGY_BEFORE + lane] = energy
        tile[of.HUB + lane] = hub
        tile[of.HUB_BEFORE + lane] = hub
        tile[of.FOOT_BEFORE + lane] = tile[of.FOOT + lane]
        tile[of.BOOKED + row.MIN_NORMAL_FORCE * LANES + lane] = fy
        tile[of.BOOKED + row.FRICTION_DEMAND * LANES + lane] = demand
        tile[of.BOOKED + row.CLEARANCE * LANES + lane] = clearance
        tile[of.BOOKED + row.FORCE_X * LANES + lane] = fx
        tile[of.BOOKED + row.FORCE_Y * LANES + lane] = fy
        tile[of.FAILURE + lane] = CONTACT_LOST if -pull - fy > 0.0 else OK
        tile[of.LEFT + lane] = duration
        tile[of.EVENTS + lane] = 0.0
        tile[of.BOOKED + row.TOUCHDOWN_TIME * LANES + lane] = -1.0
        tile[of.BOOKED + row.TOUCHDOWNS * LANES + lane] = 0.0
        tile[of.BOOKED + row.IMPULSE_FRICTION_DEMAND * LANES + lane] = 0.0
        tile[of.BOOKED + row.COLLISION * LANES + lane] = 0.0
        tile[of.BOOKED + row.ELECTRICAL * LANES + lane] = 0.0
        tile[of.BOOKED + row.ELECTRICAL_POSITIVE * LANES + lane] = 0.0
        tile[of.BOOKED + row.COPPER * LANES + lane] = 0.0
        tile[of.BOOKED + row.FRICTION * LANES + lane] = 0.0
        tile[of.BOOKED + row.DRAG * LANES + lane] = 0.0
        tile[of.BOOKED + row.SHAFT * LANES + lane] = 0.0
        clear_attempt(tile, lane)


@inlined
def close(tile, lane, duration):
    """Book what the interval as a whole amounts to so far."""
    p = machine(tile, lane)
    steps = tile[of.FOOT + lane] - tile[of.FOOT_BEFORE + lane]
    travel = tile[of.HUB + lane] - tile[of.HUB_BEFORE + lane] + steps * p.chord
    change = tile[of.ENERGY + lane] - tile[of.ENERGY_BEFORE + lane]
    descent = (p.m1 + p.m2) * p.gx * p.chord
    tile[of.BOOKED + row.TIME * LANES + lane] = duration - tile[of.LEFT + lane]
    tile[of.BOOKED + row.DISTANCE * LANES + lane] = travel
    tile[of.BOOKED + row.STEPS * LANES + lane] = steps
    tile[of.BOOKED + row.MECHANICAL_CHANGE * LANES + lane] = change - steps * descent
    tile[of.BOOKED + row.FAILURE * LANES + lane] = tile[of.FAILURE + lane]


@inlined
def clear_attempt(tile, lane):
    """Nothing tried yet of the next step."""
    tile[of.ATTEMPT + lane] = -1.0
    tile[of.GOAL + lane] = 0.0
    tile[of.LOW + lane] = 0.0
    tile[of.TRIES + lane] = 0.0
    tile[of.CUT + lane] = 0.0


@vectorised
def measure(tile, pull):
    """Forces, energies and work of the attempted step; which lanes need more than the common case.

    Returns how many lanes are marked `CURRENT`, `SPLIT` and `FLAGGED` (`rimless_gym.kernel.tile`).
    """
    current = split = flagged = 0
    for lane in range(LANES):
        y, end = get_state(tile, of.STATE, lane), get_state(tile, of.NEXT, lane)
        mode, u, h = tile[of.MODE + lane], tile[of.VOLTAGE + lane], tile[of.STEP + lane]
        p, acc = machine(tile, lane), get_pair(tile, of.ACC, lane)
        there = turned_angles(tile, lane, end[0] - y[0], end[1] - y[1])
        acc_end, contact, energy, hub = _evaluate(tile, lane, there, end[2], end[3])
        fx, fy, demand, clearance = contact
        put_pair(tile, of.NEXT_ACC, lane, acc_end)
        tile[of.FORCE_X + lane] = fx
        tile[of.FORCE_Y + lane] = fy
        tile[of.DEMAND + lane] = demand
        tile[of.CLEARANCE + lane] = clearance
        tile[of.NEXT_ENERGY + lane] = energy
        tile[of.NEXT_HUB + lane] = hub

        turn, q = relative_rate(end[0] - y[0], end[1] - y[1], p), tile[of.TURNED + lane]
        rate, rate_end = relative_rate(y[2], y[3], p), relative_rate(end[2], end[3], p)
        electrical, shaft = u * (u * h - p.K * turn) * p.G, p.K * (u * turn - p.K * q) * p.G
        tile[of.WORK_ELECTRICAL + lane] = electrical
        tile[of.WORK_POSITIVE + lane] = max(electrical, 0.0)
        tile[of.WORK_COPPER + lane] = (u * u * h - 2 * u * p.K * turn + p.K * p.K * q) * p.G
        tile[of.WORK_FRICTION + lane] = p.damping * q
        tile[of.WORK_DRAG + lane] = tile[of.BRAKED + lane]
        tile[of.WORK_SHAFT + lane] = abs(shaft)

        reach = 0.5 * h * max(abs(y[2]), abs(end[2]))
        near = max(y[0], end[0]) + reach >= p.b or min(y[0], end[0]) - reach <= p.a
        swing = y[3] * y[3] + end[3] * end[3] + abs(acc[1]) + abs(acc_end[1])
        roll = y[2] * y[2] + end[2] * end[2] + abs(acc[0]) + abs(acc_end[0])
        pressed = min(fy, tile[of.BOOKED + row.FORCE_Y * LANES + lane]) + pull
        light = pressed < DIP * (p.S2 * swing + p.S1 * roll)
        kink = p.Cd > 0.0 and y[2] * end[2] < 0.0
        sane = max(abs(end[2]), abs(end[3])) <= MAX_RATE
        sane = sane and tile[of.FAR + lane] <= MAX_TURN * MAX_TURN
        common = sane and not (near or light or kink or mode == DOUBLE)
        common = common and tile[of.GOAL + lane] == 0.0 and tile[of.CUT + lane] == 0.0
        waits = tile[of.LEFT + lane] <= 0.0 or tile[of.FAILURE + lane] != OK
        flips = of.CURRENT if (u - p.K * rate) * (u - p.K * rate_end) < 0.0 else of.PLAIN
        flips = of.SPLIT if rate * rate_end < 0.0 else flips
        flag = flips if common else of.FLAGGED
        flag = of.IDLE if waits else flag
        tile[of.FLAG + lane] = flag
        current += 1 if flag == of.CURRENT else 0
        split += 1 if flag == of.SPLIT else 0
        flagged += 1 if flag == of.FLAGGED else 0
    return current, split, flagged


@vectorised
def accept(tile, duration):
    """Take the attempted step in all lanes that made one and are not flagged any more.

    Returns how many lanes are not done.
    """
    unfinished = 0
    for lane in range(LANES):
        tile[of.EVENT + lane] = 0.0
        if tile[of.FLAG + lane] < of.FLAGGED:
            h = tile[of.STEP + lane]
            put_state(tile, of.STATE, lane, get_state(tile, of.NEXT, lane))
            put_pair(tile, of.ACC, lane, get_pair(tile, of.NEXT_ACC, lane))
            tile[of.ENERGY + lane] = tile[of.NEXT_ENERGY + lane]
            tile[of.HUB + lane] = tile[of.NEXT_HUB + lane]
            tile[of.LEFT + lane] = tile[of.LEFT + lane] - h
            tile[of.BOOKED + row.FORCE_X * LANES + lane] = tile[of.FORCE_X + lane]
            tile[of.BOOKED + row.FORCE_Y * LANES + lane] = tile[of.FORCE_Y + lane]
            _extreme(tile, lane, tile[of.FORCE_Y + lane], tile[of.DEMAND + lane])
            lowest = min(tile[of.BOOKED + row.CLEARANCE * LANES + lane], tile[of.CLEARANCE + lane])
            tile[of.BOOKED + row.CLEARANCE * LANES + lane] = lowest
            book(tile, row.ELECTRICAL, lane, tile[of.WORK_ELECTRICAL + lane])
            book(tile, row.ELECTRICAL_POSITIVE, lane, tile[of.WORK_POSITIVE + lane])
            book(tile, row.COPPER, lane, tile[of.WORK_COPPER + lane])
            book(tile, row.FRICTION, lane, tile[of.WORK_FRICTION + lane])
            book(tile, row.DRAG, lane, tile[of.WORK_DRAG + lane])
            book(tile, row.SHAFT, lane, tile[of.WORK_SHAFT + lane])
            tile[of.EVENT + lane] = tile[of.GOAL + lane]
            clear_attempt(tile, lane)
        close(tile, lane, duration)
        runs = tile[of.LEFT + lane] > 0.0 and tile[of.FAILURE + lane] == OK
        unfinished += 1 if runs else 0
    return unfinished


@inlined
def _extreme(tile, lane, fy, demand):
    least = min(tile[of.BOOKED + row.MIN_NORMAL_FORCE * LANES + lane], fy)
    most = max(tile[of.BOOKED + row.FRICTION_DEMAND * LANES + lane], demand)
    tile[of.BOOKED + row.MIN_NORMAL_FORCE * LANES + lane] = least
    tile[of.BOOKED + row.FRICTION_DEMAND * LANES + lane] = most


@inner
def forget_extremes(tile, lane):
    """No contact forces met so far."""
    tile[of.BOOKED + row.MIN_NORMAL_FORCE * LANES + lane] = np.inf
    tile[of.BOOKED + row.FRICTION_DEMAND * LANES + lane] = 0.0


@inner
def restart(tile, lane, mode, foot, y, pull):
    """Put a lane into another mode or onto another leg, and book the contact forces there.

    Two feet of which one lets go at once make no stance, and no extremes.
    """
    tile[of.MODE + lane] = mode
    tile[of.FOOT + lane] = foot
    put_state(tile, of.STATE, lane, y)
    put_sines(tile, lane)
    here, p = turned_angles(tile, lane, 0.0, 0.0), machine(tile, lane)
    acc, (fx, fy, demand, clearance), energy, hub = _evaluate(tile, lane, here, y[2], y[3])
    put_pair(tile, of.ACC, lane, acc)
    tile[of.ENERGY + lane] = energy
    tile[of.HUB + lane] = hub
    tile[of.BOOKED + row.FORCE_X * LANES + lane] = fx
    tile[of.BOOKED + row.FORCE_Y * LANES + lane] = fy
    lets_go = mode == DOUBLE and not both_feet_press(y[1], y[3], tile[of.VOLTAGE + lane], p)
    if not lets_go or -pull - fy > 0.0:
        _extreme(tile, lane, fy, demand)
    lowest = min(tile[of.BOOKED + row.CLEARANCE * LANES + lane], clearance)
    tile[of.BOOKED + row.CLEARANCE * LANES + lane] = lowest
    tile[of.EVENTS + lane] = tile[of.EVENTS + lane] + 1
    return fy


@inner
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
    most = max(tile[of.BOOKED + row.IMPULSE_FRICTION_DEMAND * LANES + lane], demand)
    tile[of.BOOKED + row.IMPULSE_FRICTION_DEMAND * LANES + lane] = most
    tile[of.BOOKED + row.TOUCHDOWN_TIME * LANES + lane] = time
