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


def with_zeros(function: Callable[[Array], Array], times: ArrayLike) -> Array:
    """`times`, with the times between them at which a component of a function changes sign.

    Args:
        function: times (N,) in s -> values (N, m). A parabola should describe each value roughly
            over any three neighbouring times.
        times: ascending, shape (N,).

    Returns:
        Ascending times, shape (N or more,).
    """
    times = np.asarray(times, dtype=np.float64)
    values, every = function(times), list(times)
    for k in np.flatnonzero(np.abs(values).max(axis=0) > NOTHING):

        def component(t: float, k: int = int(k)) -> float:
            return float(function(np.array([t]))[0, k])

        dips = _dips(component, times, values[:, k])
        if not dips and len(set((values[:, k] > 0).tolist())) == 1:
            continue
        samples = [*zip(times, values[:, k], strict=True), *dips]
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
    signs = np.where(values[:-1] > 0, 1.0, -1.0)
    nearest = np.minimum(np.abs(values[:-1]), np.abs(values[1:]))
    for i in np.flatnonzero((signs * values[1:] > 0) & (nearest < bend / 4)):
        sign, window = float(signs[i]), (times[i], times[i + 1])
        dip = minimize_scalar(lambda t, sign=sign: sign * function(t), bounds=window)
        found.append((float(dip.x), sign * float(dip.fun)))
    return found
