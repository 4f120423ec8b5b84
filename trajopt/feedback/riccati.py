"""The periodic discrete-time LQR of the deviations across a gait's orbit.

Bittanti, Colaneri and De Nicolao, The Riccati Equation, 1991, for the periodic recursion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import FINENESS
from trajopt.feedback.transverse import Transverse

#: Most rounds of the recursion, and the change, relative to the largest cost to go, at which it
#: has converged.
ROUNDS, CONVERGED = 200, 1e-9


class Optimal(NamedTuple):
    """The LQR at the m times of a `trajopt.feedback.orbit.Grid`, in coordinates of `Transverse`.

    Attributes:
        gains: (r + B' P B)^-1 B' P A of the period that begins at a time, with its cost r of a
            squared volt: volts per coordinate, shape (m, 4).
        surface: (r + B' P B)^-1 B' P of the period that ends at a time: volts per coordinate,
            shape (m, 4).
        to_go: cost to go P, shape (m, 4, 4): y' to_go y.
    """

    gains: Floats
    surface: Floats
    to_go: Floats


def riccati(transverse: Transverse, effort: float, ahead: float) -> Optimal:
    """Gains and cost to go that minimise the sum of |y|^2 + effort v^2 over all time.

    y is the deviation in coordinates of `Transverse`, with its time in units of `ahead`, and v is
    added to the gait's voltage. A period leads from a time to the `FINENESS`th after it, so that
    there are as many interleaved recursions.

    Args:
        transverse: the dynamics across the orbit.
        effort: cost of a squared volt.
        ahead: time (s) that counts like one standard deviation; infinite: time does not count.

    Raises:
        RuntimeError: the recursion has not converged after `ROUNDS` strides.
    """
    A, B, cost = transverse.A, transverse.B, weights(ahead)
    if math.isinf(ahead):
        A, B, cost = A[:, :3, :3], B[:, :3], cost[:3, :3]
    m, n = A.shape[:2]
    ends, P = np.zeros((m, 1, n)), np.tile(cost, (FINENESS, 1, 1))
    to_go = np.empty((m, n, n))
    for _ in range(ROUNDS):
        last = P
        for begin in range(m - FINENESS, -1, -FINENESS):
            each = slice(begin, begin + FINENESS)
            A_, B_ = A[each], B[each]
            BP = B_.swapaxes(1, 2) @ P
            ends[each] = BP / (effort + BP @ B_)
            P = cost + A_.swapaxes(1, 2) @ P @ (A_ - B_ @ (ends[each] @ A_))
            P = 0.5 * (P + P.swapaxes(1, 2))
            to_go[each] = P
        change = np.abs(P - last).max() / np.abs(P).max()
        if change < CONVERGED:
            break
    else:
        raise RuntimeError(
            f"the Riccati recursion still changes by {change:.2g} of the cost to go after {ROUNDS} "
            f"strides; wanted is {CONVERGED:g}: no law holds this gait with effort = {effort:g}"
        )
    more = 0, 4 - n
    gains = np.pad((ends @ A)[:, 0], ((0, 0), more))
    surface = np.pad(np.roll(ends[:, 0], FINENESS, axis=0), ((0, 0), more))
    return Optimal(gains, surface, np.pad(to_go, ((0, 0), more, more)))


def weights(ahead: float) -> Floats:
    """The cost (4, 4) of a deviation in coordinates of `Transverse`; see `riccati`."""
    return np.diag([1.0, 1.0, 1.0, ahead**-2])
