"""Checks of the names and bounds that callers give."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

#: Bounds by name: (lower, upper), or one number where both are equal. Unbounded names are left out.
Bounds = Mapping[str, float | tuple[float, float]]


class InfeasibleBoundsError(ValueError):
    """Bounds contradict each other: there is nothing to solve."""


def pair(bounds: float | tuple[float, float]) -> tuple[float, float]:
    """Bounds as (lower, upper); one number stands for both."""
    low, high = bounds if isinstance(bounds, (Sequence, np.ndarray)) else (bounds, bounds)
    return float(low), float(high)


def pair_in(where: str, bounds: Any) -> tuple[float, float]:
    """Like `pair`, for a value that may be of any type.

    Args:
        where: what is bounded, for messages.
        bounds: to check.

    Raises:
        TypeError: it is neither a number nor a pair of numbers.
        ValueError: an integer is too large for a floating-point number.
    """
    both = bounds if isinstance(bounds, (Sequence, np.ndarray)) else (bounds, bounds)
    kinds = (int, float, np.integer, np.floating)
    good = [isinstance(bound, kinds) and not isinstance(bound, bool) for bound in both]
    if good != [True, True]:
        raise TypeError(f"{where} = {bounds!r}: must be a real number, or (lower, upper)")
    try:
        return pair(bounds)
    except OverflowError:  # an integer of hundreds of digits
        raise ValueError(f"{where}: must be finite, or math.inf where there is no bound") from None


def require_room(where: str, low: float, high: float) -> None:
    """Refuse bounds that no number satisfies.

    Raises:
        InfeasibleBoundsError: no number lies between them, or one is NaN.
    """
    if math.isnan(low) or math.isnan(high):
        raise InfeasibleBoundsError(f"{where}: bounds ({low}, {high}): must be numbers, not NaN")
    if low == math.inf or high == -math.inf:
        raise InfeasibleBoundsError(
            f"{where}: bounds ({low}, {high}): nothing lies between them; make them finite"
        )
    if low > high:
        raise InfeasibleBoundsError(
            f"{where}: the lower bound {low:g} exceeds the upper bound {high:g}: swap them"
        )


def require_bounds(where: str, table: Any, known: Sequence[str] | None = None) -> None:
    """Refuse a table with invalid bounds or, where `known` is given, with an unknown name.

    Raises:
        InfeasibleBoundsError: no number lies between the bounds of a name.
        TypeError: it is not a mapping from names to bounds.
        ValueError: it has an unknown name.
    """
    if not isinstance(table, Mapping) or not all(isinstance(name, str) for name in table):
        raise TypeError(f"{where} = {table!r}: must be a mapping, name: (lower, upper)")
    unknown = [name for name in table if known is not None and name not in known]
    if unknown:
        raise ValueError(f"{where} names {unknown}, which are not among {known}")
    for name, bounds in table.items():
        require_room(f"{where} of {name}", *pair_in(f"{where} of {name}", bounds))


def names_in(where: str, names: Any, least: int = 0) -> tuple[str, ...]:
    """Names as a tuple.

    Raises:
        TypeError: they are not a sequence of strings.
        ValueError: there are fewer than `least`.
    """
    wanted = "give a tuple of names, such as ('x',) for a single one"
    if least:
        wanted += f"; at least {least}"
    if (
        isinstance(names, str)
        or not isinstance(names, Sequence)
        or not all(isinstance(name, str) for name in names)
    ):
        raise TypeError(f"{where} = {names!r}: {wanted}")
    if len(names) < least:
        raise ValueError(f"{where} = {names!r}: {wanted}")
    return tuple(names)
