"""Location of events within a step: the attempt at the step is judged, and shortened if need be.

A touchdown is first located on the quintic through the step's ends. The step is then shortened to
end there, and corrected until the leg is on its guard. Lift-off and loss of contact are located in
the same way, on the forces. Every correction is another attempt at the same step.
"""

from __future__ import annotations

import numpy as np

from rimless_gym.equations import SINGLE, State
from rimless_gym.hybrid import (
    DIVERGED,
    MAX_RATE,
    accelerations,
    contact_guard,
    crosses_kink,
    ground_reaction,
    lift_off_guard,
    touchdown_guard,
)
from rimless_gym.jit import inner
from rimless_gym.kernel import tile as of
from rimless_gym.kernel.interpolation import (
    derivative,
    negative,
    quintic,
    slope,
    upward_root,
    value,
)
from rimless_gym.kernel.tile import get_acc, get_state, machine, put_state
from rimless_gym.trigonometry import MAX_TURN

LOCATED = 1e-13  # rad: how near to its guard a located touchdown is
GRAZE = 1e-6  # rad: where a leg reverses this near to its guard, a step ends

#: What a step may end on; the first two are also the directions of a touchdown.
FORWARD, BACKWARD, NOTHING, LIFT_OFF, RELEASE = (np.int64(k) for k in (1, -1, 0, 2, 3))

_AT_REVERSAL, _AT_TURN = 1, 2  # what may have cut a step
_HERE = 1e-6  # fraction of a step: a cut this near to its start has been made already


@inner
def past_guard(direction, y0, acc0, y1, acc1, h, p):
    """Quintic of how far the leg is past a guard (rad) over a step."""
    return quintic(
        touchdown_guard(direction, y0.phi, p),
        direction * y0.dphi,
        direction * acc0.ddphi,
        touchdown_guard(direction, y1.phi, p),
        direction * y1.dphi,
        direction * acc1.ddphi,
        h,
    )


@inner
def turning_cut(y0, acc0, y1, acc1, h, p):
    """Fraction at which to cut a step, so that near a guard the leg reverses only at steps' ends.

    It is 1 where the leg is far from its guards. A turning point within `GRAZE` of a guard becomes
    the end of a step, where the state is exact. So does an inflection, because it separates two
    turning points.
    """
    for direction in (FORWARD, BACKWARD):
        c = past_guard(direction, y0, acc0, y1, acc1, h, p)
        if max(c[0], value(c, 1.0)) + 0.5 * h * max(abs(y0.dphi), abs(y1.dphi)) < 0.0:
            continue
        if acc0.ddphi * acc1.ddphi < 0.0:
            bend = derivative(derivative(c))
            s = upward_root(bend if bend[0] < 0.0 else negative(bend), 1.0)
            if 1e-3 < s < 0.999:
                return s
        if c[1] > 0.0 and slope(c, 1.0) < 0.0:
            s = upward_root(negative(derivative(c)), 1.0)
            if abs(value(c, s)) < GRAZE and _HERE < s < 0.9999:
                return s
    return 1.0


@inner
def touchdown_crossing(y0, acc0, y1, acc1, h, p):
    """First touchdown within a single-stance step: (direction or NOTHING, s near it, s past it)."""
    found, s_found, s_past = NOTHING, 2.0, 1.0
    for direction in (FORWARD, BACKWARD):
        c = past_guard(direction, y0, acc0, y1, acc1, h, p)
        s_end = 1.0
        if c[1] > 0.0 and slope(c, 1.0) < 0.0:  # it turns back inside the step: look at the top
            s_end = upward_root(negative(derivative(c)), 1.0)
        if value(c, s_end) > 0.1 * LOCATED:
            s = upward_root(c, s_end)
            if s < s_found:
                found, s_found, s_past = direction, s, s_end
    return found, s_found, s_past


@inner
def reversal(y0, acc0, y1, acc1, h):
    """Fraction of a step at which phi' changes sign, given that it does."""
    rate = derivative(quintic(y0.phi, y0.dphi, acc0.ddphi, y1.phi, y1.dphi, acc1.ddphi, h))
    return upward_root(rate if y1.dphi > 0.0 else negative(rate), 1.0)


@inner
def between(y0, acc0, y1, acc1, h, s):
    """State at fraction s of a step, from the quintics through its ends."""
    c = quintic(y0.phi, y0.dphi, acc0.ddphi, y1.phi, y1.dphi, acc1.ddphi, h)
    e = quintic(y0.theta, y0.dtheta, acc0.ddtheta, y1.theta, y1.dtheta, acc1.ddtheta, h)
    return State(value(c, s), value(e, s), slope(c, s) / h, slope(e, s) / h)


@inner
def force_guard(kind, mode, y, u, pull, p):
    """Positive once a foot would have to be pulled down.

    `LIFT_OFF`: one of two standing feet, in units of phi''. `RELEASE`: the feet together, in N
    beyond the largest `pull` that the ground can exert.
    """
    if kind == LIFT_OFF:
        return lift_off_guard(y.theta, y.dtheta, u, p)
    a = accelerations(mode, y.phi, y.theta, y.dphi, y.dtheta, u, p)
    fy = ground_reaction(y.phi, y.theta, y.dphi, y.dtheta, a.ddphi, a.ddtheta, p)[1]
    return contact_guard(fy, pull)


@inner
def judge(tile, lane, pull):
    """Whether the attempt at a step stands; if not, this sets up the next one, or the failure."""
    y, acc = get_state(tile, of.STATE, lane), get_acc(tile, of.ACC, lane)
    end, acc_end = get_state(tile, of.NEXT, lane), get_acc(tile, of.NEXT_ACC, lane)
    mode, u, h = tile[of.MODE + lane], tile[of.VOLTAGE + lane], tile[of.STEP + lane]
    goal, cut, p = int(tile[of.GOAL + lane]), int(tile[of.CUT + lane]), machine(tile, lane)
    if not max(abs(end.dphi), abs(end.dtheta)) < 10 * MAX_RATE:
        tile[of.FAILURE + lane] = DIVERGED  # so fast, or NaN, that the step cannot be trusted
        return False
    if goal == NOTHING:
        if tile[of.FAR + lane] > MAX_TURN * MAX_TURN:  # its sines are not accurate that far
            tile[of.ATTEMPT + lane] = 0.5 * h
            return False
        if crosses_kink(y.dphi, end.dphi, p) and not cut:  # air drag has a kink: end there
            tile[of.CUT + lane] = _AT_REVERSAL
            s = reversal(y, acc, end, acc_end, h)
            if s > _HERE:
                tile[of.ATTEMPT + lane] = s * h
                return False
        if mode == SINGLE:
            if cut < _AT_TURN:
                s = turning_cut(y, acc, end, acc_end, h, p)
                if s < 1.0:
                    tile[of.CUT + lane] = _AT_TURN
                    tile[of.ATTEMPT + lane] = s * h
                    return False
            event, s, s_past = touchdown_crossing(y, acc, end, acc_end, h, p)
            if event != NOTHING:
                tile[of.GOAL + lane] = event
                tile[of.HIGH + lane] = s_past * h
                tile[of.ATTEMPT + lane] = s * h
                return False
        elif force_guard(LIFT_OFF, mode, end, u, pull, p) > 0.0:
            _aim_at_force(tile, lane, LIFT_OFF, end, h, pull)
            return False
    elif not (_lands(tile, lane, goal, h) if abs(goal) == 1 else _lets_go(tile, lane, goal, pull)):
        return False
    if goal != RELEASE and h > 0.0:
        end = get_state(tile, of.NEXT, lane)
        for s in (0.5, 1.0):
            there = between(y, acc, end, acc_end, h, s) if s < 1.0 else end
            if force_guard(RELEASE, mode, there, u, pull, p) > 0.0:
                _aim_at_force(tile, lane, RELEASE, there, s * h, pull)
                return False
    return True


@inner
def _lands(tile, lane, direction, tau):
    """Whether an attempt of length tau ends on the guard; if not, this sets up the next one.

    That is a step of Newton's method along phi', or of bisection if Newton leaves the bracket.
    """
    p = machine(tile, lane)
    end = get_state(tile, of.NEXT, lane)
    low, high, tries = tile[of.LOW + lane], tile[of.HIGH + lane], tile[of.TRIES + lane]
    miss = touchdown_guard(direction, end.phi, p)
    if abs(miss) <= LOCATED or high - low <= 1e-16 or tries >= 60:
        bound = p.b if direction > 0 else p.a
        put_state(tile, of.NEXT, lane, (bound, end.theta, end.dphi, end.dtheta))
        return True
    if miss > 0.0:
        high = tau
    else:
        low = tau
    newton = tau - miss / (direction * end.dphi)
    tile[of.ATTEMPT + lane] = newton if low < newton < high else 0.5 * (low + high)
    tile[of.LOW + lane] = low
    tile[of.HIGH + lane] = high
    tile[of.TRIES + lane] = tries + 1
    return False


@inner
def _aim_at_force(tile, lane, kind, end, h, pull):
    """Aim at the time when a force guard turns positive; at `end`, after a time h, it is positive.

    Bisection on the quintics gives the first attempt.
    """
    y, acc = get_state(tile, of.STATE, lane), get_acc(tile, of.ACC, lane)
    mode, u, p = tile[of.MODE + lane], tile[of.VOLTAGE + lane], machine(tile, lane)
    acc_end = accelerations(mode, end.phi, end.theta, end.dphi, end.dtheta, u, p)
    low, high = 0.0, 1.0
    while high - low > 1e-15:
        middle = 0.5 * (low + high)
        if force_guard(kind, mode, between(y, acc, end, acc_end, h, middle), u, pull, p) > 0.0:
            high = middle
        else:
            low = middle
    tile[of.GOAL + lane] = kind
    tile[of.ATTEMPT + lane] = high * h
    tile[of.HIGH + lane] = h
    tile[of.BEFORE + lane] = h
    tile[of.MISS_BEFORE + lane] = force_guard(kind, mode, end, u, pull, p)
    tile[of.TRIES + lane] = 0.0


@inner
def _lets_go(tile, lane, kind, pull):
    """Whether an attempt ends where a force guard turns positive; if not, this sets up the next.

    There are at most two, both steps of the secant method.
    """
    end, tau = get_state(tile, of.NEXT, lane), tile[of.STEP + lane]
    mode, u, p = tile[of.MODE + lane], tile[of.VOLTAGE + lane], machine(tile, lane)
    miss, tries = force_guard(kind, mode, end, u, pull, p), tile[of.TRIES + lane]
    before, miss_before = tile[of.BEFORE + lane], tile[of.MISS_BEFORE + lane]
    if tries >= 2 or miss in (0.0, miss_before):
        return True
    corrected = tau - miss * (tau - before) / (miss - miss_before)
    tile[of.ATTEMPT + lane] = min(max(corrected, 0.0), tile[of.HIGH + lane])
    tile[of.BEFORE + lane] = tau
    tile[of.MISS_BEFORE + lane] = miss
    tile[of.TRIES + lane] = tries + 1
    return False
