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

#: Most rounds of the recursion, and the change (relative) at which it has converged.
ROUNDS, CONVERGED = 200, 1e-9


class Optimal(NamedTuple):
    """The LQR at the times of a `trajopt.feedback.orbit.Grid`, in coordinates of `Transverse`.

    Attributes:
        gains: volts per coordinate, shape (m, 4).
        to_go: cost to go, shape (m, 4, 4): y' to_go y.
    """

    gains: Floats
    to_go: Floats


def riccati(transverse: Transverse, effort: float, ahead: float) -> Optimal:
    """The LQR for a squared standard deviation that costs 1.

    A period leads from a time to the `FINENESS`th after it, so that there are as many interleaved
    recursions.

    Args:
        transverse: the dynamics across the orbit.
        effort: cost of a squared volt.
        ahead: time (s) that counts like one standard deviation; infinite: time does not count.
    """
    A, B, cost = transverse.A, transverse.B, weights(ahead)
    if math.isinf(ahead):
        A, B, cost = A[:, :3, :3], B[:, :3], cost[:3, :3]
    m, n = A.shape[:2]
    gains, P = np.zeros((m, 1, n)), np.tile(cost, (FINENESS, 1, 1))
    to_go = np.empty((m, n, n))
    for _ in range(ROUNDS):
        last = P
        for begin in range(m - FINENESS, -1, -FINENESS):
            each = slice(begin, begin + FINENESS)
            A_, B_ = A[each], B[each]
            BP = B_.swapaxes(1, 2) @ P
            gains[each] = np.linalg.solve(effort + BP @ B_, BP @ A_)
            P = cost + A_.swapaxes(1, 2) @ P @ (A_ - B_ @ gains[each])
            P = 0.5 * (P + P.swapaxes(1, 2))
            to_go[each] = P
        if np.allclose(P, last, rtol=CONVERGED, atol=0.0):
            break
    more = 0, 4 - n
    return Optimal(np.pad(gains[:, 0], ((0, 0), more)), np.pad(to_go, ((0, 0), more, more)))


def weights(ahead: float) -> Floats:
    """The cost (4, 4) of a deviation in coordinates of `Transverse`; see `riccati`."""
    return np.diag([1.0, 1.0, 1.0, ahead**-2])
