"""Choices that rounding does not turn: what a solver cannot tell apart is a tie.

Costs of one optimum that was reached in two ways differ in their last digits, and by which sign
depends on the processor. Where the least is wanted, a tie goes to what stands first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")

#: Costs that differ by less, relative or (J, or whatever they are in) absolute, are equal: some
#: times what IPOPT leaves open, and far less than anyone cares about.
TIE, TINY = 1e-6, 1e-9


def tied(one: float, other: float, tie: float = TIE) -> bool:
    """Whether two costs are equal but for what a solver leaves open, by `tie` (relative)."""
    return math.isclose(one, other, rel_tol=tie, abs_tol=TINY)


def clearly_less(one: float, other: float) -> bool:
    """Whether one cost is less than another, and not by a hair."""
    return one < other and not tied(one, other)


def least_first(items: Iterable[T], cost: Callable[[T], float], tie: float = TIE) -> list[T]:
    """In order of cost; among those that tie with the least of them, in the order given."""
    ranked: list[T] = []
    ties: list[tuple[int, T]] = []
    least = math.nan
    for index, item in sorted(enumerate(items), key=lambda pair: cost(pair[1])):
        if not tied(cost(item), least, tie):
            ranked += [other for _, other in sorted(ties, key=lambda pair: pair[0])]
            ties, least = [], cost(item)
        ties.append((index, item))
    return ranked + [item for _, item in sorted(ties, key=lambda pair: pair[0])]
