"""Choices that do not depend on rounding: costs that a solver cannot tell apart are ties.

The costs of one optimum reached in two ways differ in their last digits, and which is less depends
on the processor. Among tied costs the first one wins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")

#: Costs that differ by less than this, relative or absolute (in the cost's own unit), are equal. It
#: is a few times what IPOPT leaves open, and far less than matters.
TIE, TINY = 1e-6, 1e-9


def tied(one: float, other: float, tie: float = TIE) -> bool:
    """Whether two costs differ by no more than a solver leaves open, `tie` (relative)."""
    return math.isclose(one, other, rel_tol=tie, abs_tol=TINY)


def clearly_less(one: float, other: float) -> bool:
    """Whether one cost is less than another and not tied with it."""
    return one < other and not tied(one, other)


def least_first(items: Iterable[T], cost: Callable[[T], float], tie: float = TIE) -> list[T]:
    """The items in order of cost; those that tie with the least of a group keep their order."""
    ranked: list[T] = []
    ties: list[tuple[int, T]] = []
    least = math.nan
    for index, item in sorted(enumerate(items), key=lambda pair: cost(pair[1])):
        if not tied(cost(item), least, tie):
            ranked += [other for _, other in sorted(ties, key=lambda pair: pair[0])]
            ties, least = [], cost(item)
        ties.append((index, item))
    return ranked + [item for _, item in sorted(ties, key=lambda pair: pair[0])]
