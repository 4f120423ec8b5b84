"""One 8th-order Runge-Kutta step of the smooth motion between events (Dormand-Prince, DOP853).

Positions and rates of a stage follow from the accelerations of the stages before it alone:

    v_i = v + h sum_j A_ij a_j,    x_i = x + c_i h v + h^2 sum_j (A A)_ij a_j.

This is the same method with half the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from rimless_gym.equations import LOSSES, SINGLE
from rimless_gym.hybrid import accelerations, accelerations_turned, losses, relative_rate
from rimless_gym.jit import cached, inlined, inner, vectorised
from rimless_gym.kernel import tile as slot
from rimless_gym.kernel.tile import (
    LANES,
    STAGES,
    TILE_SIZE,
    add_losses,
    constants,
    get_acc,
    get_state,
    one_copy,
    put_acc,
    put_losses,
    put_sines,
    put_state,
    turned_angles,
)
from rimless_gym.params import N_CONSTANTS, WheelParams

_A, _B = DOP853.A, DOP853.B


@inlined
def _lose(tile, lane, time, dphi, dtheta, acc):
    """Add the losses of a stage, weighted by a time (s)."""
    p = constants(tile, lane)
    dpsi, ddpsi = relative_rate(dphi, dtheta, p), relative_rate(acc.ddphi, acc.ddtheta, p)
    powers = losses(dphi, dpsi, ddpsi, tile[slot.VOLTAGE + lane], p)
    add_losses(tile, slot.LOST, lane, time, powers)


_no_losses = (0.0,) * len(LOSSES)


def _terms(
    weights: NDArray[np.float64],
) -> tuple[int, tuple[np.int64, ...], tuple[float, ...]]:
    """Terms of a sum over the stages: how many there are, their places and their weights."""
    used = [j for j, weight in enumerate(weights) if abs(weight) > 1e-15]  # less is a rounded zero
    used = used or [0]  # numba cannot compile a loop over an empty tuple
    offsets = tuple(slot.STAGE_ACC + 2 * j * LANES for j in used)
    return len(used), offsets, tuple(float(weights[j]) for j in used)


def _stage(i: int) -> Callable[..., None]:
    """Compiled: the accelerations at stage `i`, or for i = 12 the state NEXT at the step's end.

    It also adds what the stage contributes to the losses.
    """
    rates = _A[i, :i] if i < STAGES else _B
    positions = rates @ _A[:i, :i]
    (n, at, w), (nn, att, ww) = _terms(rates), _terms(positions)
    c = float(rates.sum())
    acc = slot.STAGE_ACC + 2 * i * LANES
    share = float(_B[i]) if i < STAGES else 0.0

    def stage(tile):
        for lane in range(LANES):
            h, y = tile[slot.STEP + lane], get_state(tile, slot.STATE, lane)
            v0, v1, x0, x1 = y.dphi, y.dtheta, c * y.dphi, c * y.dtheta
            for m in range(n):
                v0 += w[m] * tile[at[m] + lane]
                v1 += w[m] * tile[at[m] + LANES + lane]
            for m in range(nn):
                x0 += ww[m] * tile[att[m] + lane]
                x1 += ww[m] * tile[att[m] + LANES + lane]
            x0, x1 = h * x0, h * x1
            if i < STAGES:
                mode, u, p = (
                    tile[slot.MODE + lane],
                    tile[slot.VOLTAGE + lane],
                    constants(tile, lane),
                )
                there = turned_angles(tile, lane, x0, x1)
                here = accelerations_turned(mode, *there, v0, v1, u, p)
                put_acc(tile, acc, lane, (h * here.ddphi, h * here.ddtheta))
                if share != 0.0:
                    _lose(tile, lane, share * h, v0, v1, here)
            else:
                put_state(tile, slot.NEXT, lane, (y.phi + x0, y.theta + x1, v0, v1))
            tile[slot.FAR + lane] = max(tile[slot.FAR + lane], x0 * x0 + x1 * x1)

    # Machine code refers to functions by name, even to those that other processes have cached.
    stage.__qualname__ = f"stage_{i}"
    return vectorised(stage)


@vectorised
def _begin(tile):
    for lane in range(LANES):
        h, y = tile[slot.STEP + lane], get_state(tile, slot.STATE, lane)
        acc = get_acc(tile, slot.ACC, lane)
        put_losses(tile, slot.LOST, lane, _no_losses)
        _lose(tile, lane, _SHARE * h, y.dphi, y.dtheta, acc)
        put_acc(tile, slot.STAGE_ACC, lane, (h * acc.ddphi, h * acc.ddtheta))
        tile[slot.FAR + lane] = 0.0


_SHARE = float(_B[0])
_s1, _s2, _s3, _s4, _s5, _s6, _s7, _s8, _s9, _s10, _s11, _end = (
    _stage(i) for i in range(1, STAGES + 1)
)


@vectorised
def find_sines(tile):
    """The sines and cosines of all lanes' angles."""
    one_copy()
    for lane in range(LANES):
        put_sines(tile, lane)


@vectorised
def rk8(tile):
    """Advance all lanes from STATE by STEP: NEXT, LOST and FAR.

    ACC and SINES are those of STATE.
    """
    _begin(tile)
    _s1(tile)
    _s2(tile)
    _s3(tile)
    _s4(tile)
    _s5(tile)
    _s6(tile)
    _s7(tile)
    _s8(tile)
    _s9(tile)
    _s10(tile)
    _s11(tile)
    _end(tile)


@cached()
def _smooth_step(tile):
    """Step on from NEXT in single stance, without guards."""
    for lane in range(LANES):
        y, u, p = get_state(tile, slot.NEXT, lane), tile[slot.VOLTAGE + lane], constants(tile, lane)
        put_state(tile, slot.STATE, lane, y)
        acc = accelerations(float(SINGLE), y.phi, y.theta, y.dphi, y.dtheta, u, p)
        put_acc(tile, slot.ACC, lane, acc)
        put_sines(tile, lane)
    rk8(tile)


def smooth_states(
    params: WheelParams, y: Sequence[float], u: float, duration: float, steps: int
) -> Iterator[NDArray[np.float64]]:
    """States (4,) after each of `steps` steps in single stance from `y` at `u` volts, no guards."""
    tile = np.zeros(TILE_SIZE)
    lane = tile.reshape(-1, LANES)[:, 0]  # the others stay empty
    end = slot.NEXT // LANES
    lane[slot.CONSTANTS // LANES :][:N_CONSTANTS] = params.constants
    lane[slot.VOLTAGE // LANES], lane[slot.STEP // LANES] = u, duration / steps
    lane[end : end + 4] = y
    for _ in range(steps):
        _smooth_step(tile)
        yield lane[end : end + 4].copy()


# -- Quintic Hermite interpolation over one integration step, and its first root -------------------
#
# Value, rate and acceleration are known at both ends of a step, so events inside it are located to
# the accuracy of the step itself (error ~ h^6 y^(6) / 46080) without evaluating the dynamics again.
# Polynomials are in s = t/h in [0, 1] and written out as six scalars, which numba keeps in
# registers.


@inner
def quintic(y0, v0, a0, y1, v1, a1, h):
    """Coefficients c0..c5 of the quintic with the given values, rates and accelerations."""
    c1, c2 = v0 * h, 0.5 * a0 * h * h
    d = y1 - y0 - c1 - c2
    e = (v1 - v0 - a0 * h) * h
    f = 0.5 * (a1 - a0) * h * h
    return y0, c1, c2, 10 * d - 4 * e + f, -15 * d + 7 * e - 2 * f, 6 * d - 3 * e + f


@inner
def value(c, s):
    """The polynomial at s."""
    return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5]))))


@inner
def slope(c, s):
    """Its derivative by s."""
    return c[1] + s * (2 * c[2] + s * (3 * c[3] + s * (4 * c[4] + s * 5 * c[5])))


@inner
def derivative(c):
    """Coefficients of the derivative by s."""
    return c[1], 2 * c[2], 3 * c[3], 4 * c[4], 5 * c[5], 0.0


@inner
def negative(c):
    """Coefficients with the sign changed."""
    return -c[0], -c[1], -c[2], -c[3], -c[4], -c[5]


@inner
def bracketed_root(c, low, high):
    """The root between `low`, where the polynomial is not positive, and `high`, where it is."""
    s = 0.5 * (low + high)
    for _ in range(100):
        f = value(c, s)
        if f > 0.0:
            high = s
        else:
            low = s
        newton = s - f / slope(c, s)
        following = newton if low <= newton <= high else 0.5 * (low + high)
        if abs(following - s) <= 1e-15:  # of s in [0, 1]; any closer, rounding makes it jump about
            return following
        s = following
    return s


@inner
def upward_root(c, s_end):
    """Where the polynomial crosses zero upward in [0, s_end], given that it is positive at s_end.

    If it starts on or above zero and rises, the crossing is at 0. If it starts at zero and falls
    (just after an impact), the root at 0 is divided out and the next one is returned. Where its
    rate is 0 too, just after a lift-off, the root at 0 is double. The bend there is then all but 0,
    of either sign: it is a rise only if it outlasts the step's first millionth.
    """
    if c[0] >= 0.0:
        if c[1] > 0.0 or (c[1] == 0.0 and c[2] >= 0.0 and c[2] + 1e-6 * c[3] >= 0.0):
            return 0.0
        c = (c[1], c[2], c[3], c[4], c[5], 0.0)
        if c[0] == 0.0:
            c = (min(c[1], 0.0), c[2], c[3], c[4], c[5], 0.0)
    return bracketed_root(c, 0.0, s_end)
