"""Locating events inside an integration step, on the quintic through the step's ends."""

from __future__ import annotations

from numba import njit

from rimless_gym.hybrid import accelerations, ground_reaction, lift_off_guards
from rimless_gym.integration import rk8
from rimless_gym.interpolation import (
    derivative,
    negative,
    quintic,
    slope,
    upward_root,
    value,
)

GUARD_TOLERANCE = 1e-13  # rad: how near to its guard a located touchdown is
GRAZE = 1e-6  # rad: a leg that turns so near to its guard ends a step there

#: What may cut a step short; the first two are also the directions of a touchdown.
FORWARD, BACKWARD, NOTHING, LIFT_OFF, RELEASE = 1, -1, 0, 2, 3


@njit(error_model="numpy")
def past_guard(direction, y0, acc0, y1, acc1, h, p):
    """Quintic of how far the leg is past a guard (rad) over a step."""
    bound = p.b if direction > 0 else p.a
    return quintic(
        direction * (y0[0] - bound),
        direction * y0[2],
        direction * acc0[0],
        direction * (y1[0] - bound),
        direction * y1[2],
        direction * acc1[0],
        h,
    )


@njit(error_model="numpy")
def turning_cut(y0, acc0, y1, acc1, h, p):
    """Fraction of a step to end it at, so that near a guard the leg turns only at steps' ends.

    1 where the leg is far from its guards. A turning point within `GRAZE` of a guard becomes the
    end of a step, where the state is exact; so does an inflection, which parts two turning points.
    """
    for direction in (FORWARD, BACKWARD):
        c = past_guard(direction, y0, acc0, y1, acc1, h, p)
        if max(c[0], value(c, 1.0)) + 0.5 * h * max(abs(y0[2]), abs(y1[2])) < 0.0:
            continue
        if acc0[0] * acc1[0] < 0.0:
            bend = derivative(derivative(c))
            s = upward_root(bend if bend[0] < 0.0 else negative(bend), 1.0)
            if 1e-3 < s < 0.999:
                return s
        if c[1] > 0.0 and slope(c, 1.0) < 0.0:
            s = upward_root(negative(derivative(c)), 1.0)
            if abs(value(c, s)) < GRAZE and s < 0.9999:
                return s
    return 1.0


@njit(error_model="numpy")
def touchdown_crossing(y0, acc0, y1, acc1, h, p):
    """First touchdown within a single-stance step: (direction or NOTHING, s near it, s past it)."""
    found, s_found, s_past = NOTHING, 2.0, 1.0
    for direction in (FORWARD, BACKWARD):
        c = past_guard(direction, y0, acc0, y1, acc1, h, p)
        s_end = 1.0
        if c[1] > 0.0 and slope(c, 1.0) < 0.0:  # it turns back inside the step: look at the top
            s_end = upward_root(negative(derivative(c)), 1.0)
        if value(c, s_end) > 0.1 * GUARD_TOLERANCE:
            s = upward_root(c, s_end)
            if s < s_found:
                found, s_found, s_past = direction, s, s_end
    return found, s_found, s_past


@njit(error_model="numpy")
def step_to_touchdown(direction, s, s_past, mode, y, acc, u, h, p, k):
    """Step to the touchdown near s h, before s_past h, corrected until phi is on its guard.

    Newton's method along phi' on re-stepped states, kept within its bracket by bisection.
    Returns (time, state on the guard, the two integrals of `rk8`).
    """
    bound = p.b if direction > 0 else p.a
    tau, low, high = s * h, 0.0, s_past * h
    after, q, d = rk8(mode, y, acc, u, tau, p, k)
    for _ in range(60):
        miss = direction * (after[0] - bound)
        if abs(miss) <= GUARD_TOLERANCE or high - low <= 1e-16:
            break
        if miss > 0.0:
            high = tau
        else:
            low = tau
        newton = tau - miss / (direction * after[2])
        tau = newton if low < newton < high else 0.5 * (low + high)
        after, q, d = rk8(mode, y, acc, u, tau, p, k)
    return tau, (bound, after[1], after[2], after[3]), q, d


@njit(error_model="numpy")
def reversal(y0, acc0, y1, acc1, h):
    """Fraction of a step at which phi' changes sign, given that it does."""
    rate = derivative(quintic(y0[0], y0[2], acc0[0], y1[0], y1[2], acc1[0], h))
    return upward_root(rate if y1[2] > 0.0 else negative(rate), 1.0)


@njit(error_model="numpy")
def between(y0, acc0, y1, acc1, h, s):
    """State at fraction s of a step, from the quintics through its ends."""
    c = quintic(y0[0], y0[2], acc0[0], y1[0], y1[2], acc1[0], h)
    e = quintic(y0[1], y0[3], acc0[1], y1[1], y1[3], acc1[1], h)
    return value(c, s), value(e, s), slope(c, s) / h, slope(e, s) / h


@njit(error_model="numpy")
def force_guard(kind, mode, y, u, pull, p):
    """Positive once a foot would have to be pulled down.

    `LIFT_OFF`: one of two standing feet, in units of phi''. `RELEASE`: the feet together, in N
    beyond the largest `pull` that the ground can exert.
    """
    if kind == LIFT_OFF:
        leading, trailing = lift_off_guards(y[1], y[3], u, p)
        return max(leading, -trailing)
    a0, a1 = accelerations(mode, y[0], y[1], y[2], y[3], u, p)
    return -pull - ground_reaction(y[0], y[1], y[2], y[3], a0, a1, p)[1]


@njit(error_model="numpy")
def step_to_force_event(kind, mode, y, acc, end, h, u, pull, p, k):
    """Step to where a force guard turns positive, given a state `end` after h where it is so.

    Bisection on the quintics brings it near, two secant steps on the re-stepped state onto it.
    Returns (time, state, the two integrals of `rk8`).
    """
    acc_end = accelerations(mode, end[0], end[1], end[2], end[3], u, p)
    low, high = 0.0, 1.0
    while high - low > 1e-15:
        middle = 0.5 * (low + high)
        if force_guard(kind, mode, between(y, acc, end, acc_end, h, middle), u, pull, p) > 0.0:
            high = middle
        else:
            low = middle
    tau, tau_before = high * h, h
    miss_before = force_guard(kind, mode, end, u, pull, p)
    after, q, d = rk8(mode, y, acc, u, tau, p, k)
    for _ in range(2):
        miss = force_guard(kind, mode, after, u, pull, p)
        if miss == miss_before or miss == 0.0:
            break
        correction = miss * (tau - tau_before) / (miss - miss_before)
        tau_before, miss_before = tau, miss
        tau = min(max(tau - correction, 0.0), h)
        after, q, d = rk8(mode, y, acc, u, tau, p, k)
    return tau, after, q, d
