"""How well the envelopes of two seeds agree, and where a front is steep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

#: Two seeds agree at a speed where their costs of transport differ by no more (relative).
AGREEMENT = 0.005

#: Between neighbouring speeds whose costs differ by more than this factor, one more is put.
STEEP = 1.25


def disagreements(one: Mapping[float, float], other: Mapping[float, float]) -> dict[float, float]:
    """By speed, by how much the larger cost exceeds the smaller (relative).

    Infinite where only one of them has a gait.

    Args:
        one: cost of transport by speed.
        other: the same of the other seed.
    """
    gaps = {}
    for speed in sorted({*one, *other}):
        if speed in one and speed in other:
            less, more = sorted((one[speed], other[speed]))
            gaps[speed] = more / less - 1
        else:
            gaps[speed] = math.inf
    return gaps


def midpoints(grid: Sequence[float], costs: Mapping[float, float], finest: float) -> list[float]:
    """Speeds to add to a grid: midway between neighbours where the front is steep, or ends.

    Args:
        grid: speeds (m/s), ascending.
        costs: of transport, at those of the grid's speeds that have a gait.
        finest: shortest distance between speeds (m/s).
    """
    wanted = []
    for low, high in pairwise(grid):
        if high - low < 2 * finest * (1 - 1e-6) or not (low in costs or high in costs):
            continue
        ends = low not in costs or high not in costs
        if ends or not 1 / STEEP < costs[high] / costs[low] < STEEP:
            wanted.append((low + high) / 2)
    return wanted
