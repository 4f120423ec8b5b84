"""Control-limited iLQR over a horizon: one iteration, compiled.

A backward pass makes a quadratic model of the cost to go, with the Gauss-Newton Hessian of all
costs. Its minimum within the voltage limit is a change of every shift, with gains for the states
that follow. A forward pass plays shares of the change on the stepping kernel, all at once, and
keeps the best (Tassa, Mansard and Todorov, Control-limited differential dynamic programming, ICRA
2014; with a single input the limited minimum is the free one, clipped).

The derivative dy/dx of the priced deviation by the state is taken as the identity. That is right up
to the orbit's curvature: along the orbit, y changes by the time ahead, or is not weighed at all.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.jit import inner
from rimless_gym.kernel.stepping import FOOT, MODE, SCRATCH_SIZE
from trajopt.feedback.horizon import (
    LANES,
    RESIDUALS,
    motion_from,
    move_on,
    priced,
    slope_of,
    slopes_of,
)
from trajopt.feedback.orbit import between, deviation


class Step(NamedTuple):
    """A change of the shifts over N intervals.

    Attributes:
        changes: (V), shape (N,).
        gains: volts per deviation from the motion so far, shape (N, 4).
    """

    changes: Any
    gains: Any


@inner
def improved(motion, lane, price, machine):  # type: ignore[no-untyped-def]
    """The motions after an iteration from one lane of others; the last one is that lane's own."""
    states, own = motion.states[:, :, lane].copy(), motion.own[:, lane].copy()
    shifts = motion.shifts[:, lane].copy()
    slopes = slopes_of(states, own, shifts, price, machine)
    step = backward(states, shifts, motion.residuals[:, :, lane], slopes, price)
    return forward(states, shifts, step, price, machine)


@inner
def backward(states, shifts, residuals, slopes, price):  # type: ignore[no-untyped-def]
    """The best `Step` of the quadratic model."""
    n = len(shifts)
    step = Step(np.zeros(n), np.zeros((n, 4)))
    spot, y = priced(states[n, :4], price)
    Vxx = between(price.final, spot).copy()
    Vx = slope_of(Vxx, y)
    for k in range(n - 1, -1, -1):
        spot, y = priced(states[k, :4], price)
        Qx, Qxx = quadratic(Vx, Vxx, residuals[k], slopes.states[k], slopes.residuals[k])
        Qx[4] += price.effort * shifts[k]
        Qxx[4, 4] += price.effort
        stage = between(price.stage, spot)
        slope = slope_of(stage, y)
        for i in range(4):
            Qx[i] += slope[i]
            for j in range(4):
                Qxx[i, j] += stage[i, j]
        own = between(price.orbit.voltages, spot) + shifts[k]
        least, most = -price.orbit.limit - own, price.orbit.limit - own
        free = -Qx[4] / Qxx[4, 4]
        change = min(max(free, least), most)
        step.changes[k] = change
        for i in range(4):
            step.gains[k, i] = -Qxx[4, i] / Qxx[4, 4] if change == free else 0.0
        gains = step.gains[k]
        for i in range(4):
            Vx[i] = Qx[i] + Qxx[i, 4] * change + gains[i] * (Qx[4] + Qxx[4, 4] * change)
            for j in range(4):
                Vxx[i, j] = Qxx[i, j] + Qxx[4, 4] * gains[i] * gains[j]
                Vxx[i, j] += gains[i] * Qxx[4, j] + Qxx[i, 4] * gains[j]
    return step


@inner
def quadratic(Vx, Vxx, residuals, slopes, residual_slopes):  # type: ignore[no-untyped-def]
    """Gradient (5,) and Hessian (5, 5) by state and shift of the cost to go, and of residuals."""
    gradient, hessian, product = np.zeros(5), np.zeros((5, 5)), np.zeros((4, 5))
    for i in range(4):
        for j in range(5):
            gradient[j] += slopes[i, j] * Vx[i]
            for c in range(4):
                product[i, j] += Vxx[i, c] * slopes[c, j]
    for i in range(5):
        for j in range(5):
            for c in range(4):
                hessian[i, j] += slopes[c, i] * product[c, j]
    for which in range(RESIDUALS):
        for i in range(5):
            gradient[i] += residual_slopes[which, i] * residuals[which]
            for j in range(5):
                hessian[i, j] += residual_slopes[which, i] * residual_slopes[which, j]
    return gradient, hessian


@inner
def forward(states, shifts, step, price, machine):  # type: ignore[no-untyped-def]
    """Play a step's shares 1, 1/2, 1/4, ... and 0, each in a lane."""
    n = len(shifts)
    out, work = np.empty((len(ROW), LANES)), np.zeros(SCRATCH_SIZE)
    motion = motion_from(states[0], n, price)
    for k in range(n):
        for lane in range(LANES):
            x = motion.states[k, :, lane]
            shift = shifts[k] + (0.5**lane * step.changes[k] if lane + 1 < LANES else 0.0)
            if x[FOOT] == states[k, FOOT] and x[MODE] == states[k, MODE]:
                d = deviation(x, states[k])
                for c in range(4):
                    shift += step.gains[k, c] * d[c]
            motion.shifts[k, lane] = shift
        move_on(motion, k, price, machine, out, work)
    return motion
