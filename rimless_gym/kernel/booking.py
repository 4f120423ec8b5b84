"""Booking a step's energies and extremes into the rows of `rimless_gym.energy`.

The losses are integrated along with the motion. With V held, the electrical energy is V times the
charge, which is exact for the step's own solution. The shaft's work is the electrical energy less
the copper loss.
"""

from __future__ import annotations

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
    friction_demand,
    linear_momentum,
    mechanical_energy,
    motor_charge,
    motor_current,
    relative_rate,
    touchdown_guard,
    turned,
)
from rimless_gym.jit import inlined, inner, vectorised
from rimless_gym.kernel import tile as of
from rimless_gym.kernel.lanes import LANES, adder
from rimless_gym.kernel.tile import (
    get_acc,
    get_losses,
    get_state,
    machine,
    put_acc,
    put_losses,
    put_state,
    turned_angles,
    unturned_angles,
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
    contact = fx, fy, friction_demand(fx, fy), _pendulum_clearance(phi, theta, p)
    energy = _mechanical_energy(phi, theta, dphi, dtheta, p)
    return acc, contact, energy, _hub_position(phi, p)[0]


@inlined
def booked(tile, row, lane):
    """One of the booked rows."""
    return tile[of.BOOKED + row * LANES + lane]


@inlined
def set_booked(tile, row, lane, value):
    """Set one of the booked rows."""
    tile[of.BOOKED + row * LANES + lane] = value


@inlined
def book(tile, row, lane, amount):
    """Add to one of the booked rows."""
    tile[of.BOOKED + row * LANES + lane] += amount


_LOSSES_BOOKED = of.BOOKED + getattr(ROW, next(iter(LOSSES))) * LANES  # they are side by side
_add_losses = adder(len(LOSSES))
_no_losses = (0.0,) * len(LOSSES)


@vectorised
def open_interval(tile, duration, pull):
    """Begin a control interval in all lanes: nothing booked, no event under way."""
    for lane in range(LANES):
        y, here = get_state(tile, of.STATE, lane), unturned_angles(tile, lane)
        acc, contact, energy, hub = _evaluate(tile, lane, here, y.dphi, y.dtheta)
        fx, fy, demand, clearance = contact
        put_acc(tile, of.ACC, lane, acc)
        tile[of.ENERGY + lane] = energy
        tile[of.ENERGY_BEFORE + lane] = energy
        tile[of.HUB + lane] = hub
        tile[of.HUB_BEFORE + lane] = hub
        tile[of.FOOT_BEFORE + lane] = tile[of.FOOT + lane]
        set_booked(tile, ROW.min_normal_force, lane, fy)
        set_booked(tile, ROW.friction_demand, lane, demand)
        set_booked(tile, ROW.clearance, lane, clearance)
        set_booked(tile, ROW.force_x, lane, fx)
        set_booked(tile, ROW.force_y, lane, fy)
        tile[of.FAILURE + lane] = CONTACT_LOST if contact_guard(fy, pull) > 0.0 else OK
        tile[of.LEFT + lane] = duration
        tile[of.EVENTS + lane] = 0.0
        set_booked(tile, ROW.touchdown_time, lane, -1.0)
        set_booked(tile, ROW.touchdowns, lane, 0.0)
        set_booked(tile, ROW.impulse_friction_demand, lane, 0.0)
        set_booked(tile, ROW.collision, lane, 0.0)
        set_booked(tile, ROW.electrical, lane, 0.0)
        set_booked(tile, ROW.electrical_positive, lane, 0.0)
        put_losses(tile, _LOSSES_BOOKED, lane, _no_losses)
        set_booked(tile, ROW.shaft, lane, 0.0)
        clear_attempt(tile, lane)


@inlined
def close(tile, lane, duration):
    """Book the totals of the interval so far."""
    p = machine(tile, lane)
    steps = tile[of.FOOT + lane] - tile[of.FOOT_BEFORE + lane]
    travel = tile[of.HUB + lane] - tile[of.HUB_BEFORE + lane] + steps * p.chord
    change = tile[of.ENERGY + lane] - tile[of.ENERGY_BEFORE + lane]
    set_booked(tile, ROW.elapsed, lane, duration - tile[of.LEFT + lane])
    set_booked(tile, ROW.distance, lane, travel)
    set_booked(tile, ROW.steps, lane, steps)
    set_booked(tile, ROW.mechanical_change, lane, change - steps * descent(p))
    set_booked(tile, ROW.failure, lane, tile[of.FAILURE + lane])


@inlined
def clear_attempt(tile, lane):
    """Forget the attempts at the last step."""
    tile[of.ATTEMPT + lane] = -1.0
    tile[of.GOAL + lane] = 0.0
    tile[of.LOW + lane] = 0.0
    tile[of.TRIES + lane] = 0.0
    tile[of.CUT + lane] = 0.0


@vectorised
def measure(tile, pull):
    """Find forces, energies and work of the attempted step, and flag what is left to do about it.

    Returns how many lanes are marked `CURRENT`, `SPLIT` and `FLAGGED` (`rimless_gym.kernel.tile`).
    """
    current = split = flagged = 0
    for lane in range(LANES):
        y, end = get_state(tile, of.STATE, lane), get_state(tile, of.NEXT, lane)
        mode, u, h = tile[of.MODE + lane], tile[of.VOLTAGE + lane], tile[of.STEP + lane]
        p, acc = machine(tile, lane), get_acc(tile, of.ACC, lane)
        there = turned_angles(tile, lane, end.phi - y.phi, end.theta - y.theta)
        acc_end, contact, energy, hub = _evaluate(tile, lane, there, end.dphi, end.dtheta)
        fx, fy, demand, clearance = contact
        put_acc(tile, of.NEXT_ACC, lane, acc_end)
        tile[of.FORCE_X + lane] = fx
        tile[of.FORCE_Y + lane] = fy
        tile[of.DEMAND + lane] = demand
        tile[of.CLEARANCE + lane] = clearance
        tile[of.NEXT_ENERGY + lane] = energy
        tile[of.NEXT_HUB + lane] = hub

        turn = relative_rate(end.phi - y.phi, end.theta - y.theta, p)
        electrical = u * motor_charge(turn, u, h, p)
        tile[of.WORK_ELECTRICAL + lane] = electrical
        tile[of.WORK_POSITIVE + lane] = max(electrical, 0.0)
        tile[of.WORK_SHAFT + lane] = abs(electrical - get_losses(tile, of.LOST, lane).copper)

        reach = 0.5 * h * max(abs(y.dphi), abs(end.dphi))
        near = touchdown_guard(1, max(y.phi, end.phi) + reach, p) >= 0.0
        near = near or touchdown_guard(-1, min(y.phi, end.phi) - reach, p) >= 0.0
        swing = y.dtheta * y.dtheta + end.dtheta * end.dtheta + abs(acc.ddtheta)
        swing += abs(acc_end.ddtheta)
        roll = y.dphi * y.dphi + end.dphi * end.dphi + abs(acc.ddphi) + abs(acc_end.ddphi)
        pressed = min(fy, booked(tile, ROW.force_y, lane)) + pull
        light = pressed < DIP * (p.S2 * swing + p.S1 * roll)
        kink = crosses_kink(y.dphi, end.dphi, p)
        sane = max(abs(end.dphi), abs(end.dtheta)) <= MAX_RATE
        sane = sane and tile[of.FAR + lane] <= MAX_TURN * MAX_TURN
        common = sane and not (near or light or kink or mode == DOUBLE)
        common = common and tile[of.GOAL + lane] == 0.0 and tile[of.CUT + lane] == 0.0
        waits = tile[of.LEFT + lane] <= 0.0 or tile[of.FAILURE + lane] != OK
        rate, rate_end = relative_rate(y.dphi, y.dtheta, p), relative_rate(end.dphi, end.dtheta, p)
        i, i_end = motor_current(rate, u, p), motor_current(rate_end, u, p)
        flips = of.CURRENT if i * i_end < 0.0 else of.PLAIN
        flips = of.SPLIT if rate * rate_end < 0.0 else flips
        ddpsi = relative_rate(acc.ddphi, acc.ddtheta, p)
        ddpsi_end = relative_rate(acc_end.ddphi, acc_end.ddtheta, p)
        beyond = h * max(abs(ddpsi), abs(ddpsi_end))  # psi' goes no further beyond its ends
        close = min(abs(rate), abs(rate_end)) < beyond
        close = close or min(abs(i), abs(i_end)) < p.K * p.G * beyond
        flips = of.SPLIT if ddpsi * ddpsi_end < 0.0 and close else flips
        flag = flips if common else of.FLAGGED
        flag = of.IDLE if waits else flag
        tile[of.FLAG + lane] = flag
        current += 1 if flag == of.CURRENT else 0
        split += 1 if flag == of.SPLIT else 0
        flagged += 1 if flag == of.FLAGGED else 0
    return current, split, flagged


@vectorised
def accept(tile, duration):
    """Accept the attempted step in all lanes that made one and are no longer flagged.

    Returns how many lanes are not done.
    """
    unfinished = 0
    for lane in range(LANES):
        tile[of.EVENT + lane] = 0.0
        if tile[of.FLAG + lane] < of.FLAGGED:
            h = tile[of.STEP + lane]
            put_state(tile, of.STATE, lane, get_state(tile, of.NEXT, lane))
            put_acc(tile, of.ACC, lane, get_acc(tile, of.NEXT_ACC, lane))
            tile[of.ENERGY + lane] = tile[of.NEXT_ENERGY + lane]
            tile[of.HUB + lane] = tile[of.NEXT_HUB + lane]
            tile[of.LEFT + lane] = tile[of.LEFT + lane] - h
            set_booked(tile, ROW.force_x, lane, tile[of.FORCE_X + lane])
            set_booked(tile, ROW.force_y, lane, tile[of.FORCE_Y + lane])
            _extreme(tile, lane, tile[of.FORCE_Y + lane], tile[of.DEMAND + lane])
            lowest = min(booked(tile, ROW.clearance, lane), tile[of.CLEARANCE + lane])
            set_booked(tile, ROW.clearance, lane, lowest)
            book(tile, ROW.electrical, lane, tile[of.WORK_ELECTRICAL + lane])
            book(tile, ROW.electrical_positive, lane, tile[of.WORK_POSITIVE + lane])
            _add_losses(tile, _LOSSES_BOOKED, lane, 1.0, get_losses(tile, of.LOST, lane))
            book(tile, ROW.shaft, lane, tile[of.WORK_SHAFT + lane])
            tile[of.EVENT + lane] = tile[of.GOAL + lane]
            clear_attempt(tile, lane)
        close(tile, lane, duration)
        runs = tile[of.LEFT + lane] > 0.0 and tile[of.FAILURE + lane] == OK
        unfinished += 1 if runs else 0
    return unfinished


@inlined
def _extreme(tile, lane, fy, demand):
    least = min(booked(tile, ROW.min_normal_force, lane), fy)
    most = max(booked(tile, ROW.friction_demand, lane), demand)
    set_booked(tile, ROW.min_normal_force, lane, least)
    set_booked(tile, ROW.friction_demand, lane, most)


@inner
def forget_extremes(tile, lane):
    """Forget the extremes of the contact forces."""
    set_booked(tile, ROW.min_normal_force, lane, np.inf)
    set_booked(tile, ROW.friction_demand, lane, 0.0)


@inner
def restart(tile, lane, mode, foot, y, pull):
    """Put a lane into another mode or onto another leg, and book the contact forces there.

    If one of two feet lifts off at once, the wheel never stood on both, so the forces do not count
    as extremes. Returns the normal force (N).
    """
    tile[of.MODE + lane] = mode
    tile[of.FOOT + lane] = foot
    put_state(tile, of.STATE, lane, y)
    here, p = unturned_angles(tile, lane), machine(tile, lane)
    acc, contact, energy, hub = _evaluate(tile, lane, here, y.dphi, y.dtheta)
    fx, fy, demand, clearance = contact
    put_acc(tile, of.ACC, lane, acc)
    tile[of.ENERGY + lane] = energy
    tile[of.HUB + lane] = hub
    set_booked(tile, ROW.force_x, lane, fx)
    set_booked(tile, ROW.force_y, lane, fy)
    u = tile[of.VOLTAGE + lane]
    lets_go = mode == DOUBLE and not both_feet_press(y.theta, y.dtheta, u, p)
    if not lets_go or contact_guard(fy, pull) > 0.0:
        _extreme(tile, lane, fy, demand)
    lowest = min(booked(tile, ROW.clearance, lane), clearance)
    set_booked(tile, ROW.clearance, lane, lowest)
    tile[of.EVENTS + lane] = tile[of.EVENTS + lane] + 1
    return fy


@inner
def book_touchdown(tile, lane, y0, y1, shift, time):
    """Add a touchdown's loss, and the friction that its impulse demands."""
    p = machine(tile, lane)
    before = mechanical_energy(y0.phi, y0.theta, y0.dphi, y0.dtheta, p)
    after = mechanical_energy(y1.phi, y1.theta, y1.dphi, y1.dtheta, p) - shift * descent(p)
    book(tile, ROW.collision, lane, before - after)
    book(tile, ROW.touchdowns, lane, 1.0)
    x0, z0 = linear_momentum(y0.phi, y0.theta, y0.dphi, y0.dtheta, p)
    x1, z1 = linear_momentum(y1.phi, y1.theta, y1.dphi, y1.dtheta, p)
    most = max(booked(tile, ROW.impulse_friction_demand, lane), friction_demand(x1 - x0, z1 - z0))
    set_booked(tile, ROW.impulse_friction_demand, lane, most)
    set_booked(tile, ROW.touchdown_time, lane, time)
