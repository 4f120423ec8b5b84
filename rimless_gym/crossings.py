"""Where functions of time change sign: guards to stop at, and kinks at which to split integrals.

Both are sampled. Where an extremum between two samples may change the sign, it is searched for.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar

Array = NDArray[np.float64]

Guards = Callable[[float, Array], tuple[float, ...]]

SAMPLES = 16  # per step of an integrator
GUARD_TOLERANCE = 1e-13  # rad, or N: a guard counts as passed above this

#: A component that nowhere exceeds this (SI units) counts as zero: its sign is rounding.
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
    dips = []
    bend = np.abs(np.diff(values, 2)).max(initial=0.0)  # a dip is at most bend / 8 deeper
    signs = np.where(values[:-1] > 0, 1.0, -1.0)
    nearest = np.minimum(np.abs(values[:-1]), np.abs(values[1:]))
    for i in np.flatnonzero((signs * values[1:] > 0) & (nearest < bend / 4)):
        sign, window = float(signs[i]), (times[i], times[i + 1])
        dip = minimize_scalar(lambda t, sign=sign: sign * function(t), bounds=window)
        dips.append((float(dip.x), sign * float(dip.fun)))
    return dips


def first_crossing(guards: Guards, dense: Any, t0: float, t1: float) -> tuple[int, float] | None:
    """The first guard to turn positive within a step, and when; None if none does."""
    times = np.linspace(t0, t1, SAMPLES + 1)
    values = np.array([guards(t, y) for t, y in zip(times, dense(times).T, strict=True)])
    first: tuple[int, float] | None = None
    for kind in range(values.shape[1]):

        def guard(time: float, kind: int = kind) -> float:
            return guards(time, dense(time))[kind]

        bracket = _first_positive(guard, times, values[:, kind])
        if bracket is None:
            continue
        low, high = bracket
        # Just after an impact the state is still on the guard: look for a time when it has left.
        while guard(low) >= 0 and high - low > 1e-15:
            low, high = (c, high) if guard(c := 0.5 * (low + high)) < 0 else (low, c)
        root = low if guard(low) >= 0 else float(brentq(guard, low, high, xtol=1e-15))
        if first is None or root < first[1]:
            first = (kind, root)
    return first


def _first_positive(
    guard: Callable[[float], float], times: Array, values: Array
) -> tuple[float, float] | None:
    """Two times that bracket the first crossing: samples, or a sample and a maximum between."""
    if not np.all(np.isfinite(values)):
        return None  # a pin joint never lets go
    bend = np.abs(np.diff(values, 2)).max()  # a maximum is at most bend / 8 above a sample
    if not np.any(values > -bend):
        return None
    times, values = _closer(guard, times, values, bend)
    last = len(times) - 1
    for i, value in enumerate(values):
        if i and value > GUARD_TOLERANCE:
            return times[i - 1], times[i]
        before, after = max(i - 1, 0), min(i + 1, last)
        if value >= max(values[before], values[after]) and value > -bend / 4:
            top = minimize_scalar(
                lambda t: -guard(t), bounds=(times[before], times[after]), options={"xatol": 1e-12}
            )
            if -top.fun > GUARD_TOLERANCE:
                return times[before], float(top.x)
    return None


def _closer(
    guard: Callable[[float], float], times: Array, values: Array, bend: float
) -> tuple[Array, Array]:
    """The samples, and more where the guard is so near 0 that it may turn more than once."""
    if values[0] > GUARD_TOLERANCE:
        return times, values
    near = np.flatnonzero(np.maximum(values[:-1], values[1:]) > -bend)
    between = [np.linspace(times[i], times[i + 1], SAMPLES + 1)[1:-1] for i in near]
    more = np.concatenate(between)
    every = np.concatenate([times, more])
    order = np.argsort(every)
    seen = np.concatenate([values, [guard(t) for t in more]])
    return every[order], seen[order]
