"""Choices that do not depend on rounding: values that a solver cannot tell apart are ties.

The costs of one optimum that is reached in two ways differ in their last digits, and which of them
is less depends on the processor. Of tied costs the first one wins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")

#: Costs that differ by less than this are tied: relative, and absolute in the cost's own unit. It
#: is a few times what IPOPT leaves open, and far less than what matters.
TIE, TINY = 1e-6, 1e-9

#: Errors that differ by less than this (relative) are tied: a solver leaves their digits open.
TIED_ERRORS = 0.01


def tied(one: float, other: float, tie: float = TIE) -> bool:
    """Whether two costs differ by no more than a solver leaves open: `tie`, relative."""
    return math.isclose(one, other, rel_tol=tie, abs_tol=TINY)


def clearly_less(one: float, other: float) -> bool:
    """Whether one cost is less than another and not tied with it."""
    return one < other and not tied(one, other)


def clearly_smaller(error: float, other: float) -> bool:
    """Whether one error is less than another and not tied with it."""
    return error < (1 - TIED_ERRORS) * other


def no_larger(error: float, other: float) -> bool:
    """Whether one error is less than another or tied with it."""
    return error <= (1 + TIED_ERRORS) * other


def least_first(items: Iterable[T], cost: Callable[[T], float], tie: float = TIE) -> list[T]:
    """The items in order of cost; items that tie with the least of a group keep their order."""
    groups: list[list[tuple[int, T]]] = []
    for pair in sorted(enumerate(items), key=lambda pair: cost(pair[1])):
        if not groups or not tied(cost(pair[1]), cost(groups[-1][0][1]), tie):
            groups.append([])
        groups[-1].append(pair)
    return [item for ties in groups for _, item in sorted(ties, key=lambda pair: pair[0])]
