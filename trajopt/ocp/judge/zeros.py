"""Times at which a function changes sign, so that integrals can be split at their kinks.

An adaptive integrator estimates its error from a few points and sometimes misses a kink between
them; whether it does depends on rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar

from trajopt.ocp.arrays import Array

#: A component whose magnitude never exceeds this counts as zero: its sign is rounding.
NOTHING = 1e-12


def with_zeros(function: Callable[[float], Array], times: ArrayLike) -> Array:
    """`times`, with the times between them at which a component of a function changes sign.

    Args:
        function: time (s) -> values, shape (m,). A parabola should describe it roughly over any
            three neighbouring times.
        times: ascending, shape (N,).

    Returns:
        Ascending times, shape (N or more,).
    """
    times = np.asarray(times, dtype=np.float64)
    values, every = np.array([function(t) for t in times]), list(times)
    for k in np.flatnonzero(np.abs(values).max(axis=0) > NOTHING):

        def component(t: float, k: int = int(k)) -> float:
            return float(function(t)[k])

        samples = [*zip(times, values[:, k], strict=True), *_dips(component, times, values[:, k])]
        every += [
            float(brentq(component, begin, end, xtol=1e-15))
            for (begin, before), (end, after) in pairwise(sorted(samples))
            if (before > 0) != (after > 0)
        ]
    return np.sort(every)


def _dips(
    function: Callable[[float], float], times: Array, values: Array
) -> list[tuple[float, float]]:
    """Times and values of extrema whose sign may differ from that of the samples on either side."""
    found = []
    bend = np.abs(np.diff(values, 2)).max(initial=0.0)  # a dip is at most bend / 8 deeper
    for window, pair in zip(pairwise(times), pairwise(values), strict=True):
        sign = 1.0 if pair[0] > 0 else -1.0
        if sign * pair[1] > 0 and np.abs(pair).min() < bend / 4:
            dip = minimize_scalar(lambda t, sign=sign: sign * function(t), bounds=window)
            found.append((float(dip.x), float(sign * dip.fun)))
    return found
