"""Figures from the workers' answers: medians over rounds, and ratios within rounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

Result = dict[str, Any]


def by_key(results: Sequence[Result]) -> dict[str, Result]:
    """The results that have answers, by key."""
    return {result["key"]: result for result in results if result["answers"]}


def rates(result: Result, time: str | None = None) -> dict[int, float]:
    """By round: steps per second, or 1 / `time` if the name of a time (s) is given."""
    if time is None:
        return {a["round"]: a["steps"] / a["seconds"] for a in result["answers"]}
    return {a["round"]: 1 / a[time] for a in result["answers"]}


def values(result: Result, name: str) -> list[float]:
    """A figure of every answer."""
    return [answer[name] for answer in result["answers"]]


def middle(figures: Sequence[float]) -> float:
    """The median."""
    return float(median(figures))


def ratio(ours: Result, theirs: Result, time: str | None = None) -> float:
    """How many times as fast ours is: the median of the ratios within the rounds that have both.

    Ratios are taken within a round because the machine may be slower in another.

    Args:
        ours: a result.
        theirs: a result.
        time: as `rates` takes it.

    Raises:
        ValueError: no round has both.
    """
    mine, other = rates(ours, time), rates(theirs, time)
    common = sorted(mine.keys() & other.keys())
    if not common:
        raise ValueError(f"{ours['key']} and {theirs['key']} have no round in common")
    return middle([mine[i] / other[i] for i in common])


def slowest_ratio(
    ours: str, theirs: Sequence[str], time: str | None = None
) -> Callable[[dict[str, Result]], float | None]:
    """Gives the smallest ratio to some peers, or None if ours or all of theirs are missing."""

    def measured(found: dict[str, Result]) -> float | None:
        peers = [found[key] for key in theirs if key in found]
        if ours not in found or not peers:
            return None
        return min(ratio(found[ours], peer, time) for peer in peers)

    return measured


def quotient(key: str, name: str, of: str) -> Callable[[dict[str, Result]], float | None]:
    """Gives the median of the quotient of two figures of a row, or None if it is missing."""

    def measured(found: dict[str, Result]) -> float | None:
        if key not in found:
            return None
        return middle([answer[name] / answer[of] for answer in found[key]["answers"]])

    return measured


def typical(key: str, name: str) -> Callable[[dict[str, Result]], float | None]:
    """Gives the median of a figure of a row, or None if it is missing."""
    return lambda found: middle(values(found[key], name)) if key in found else None


def worst(key: str, name: str) -> Callable[[dict[str, Result]], float | None]:
    """Gives the largest value of a figure of a row, or None if it is missing."""
    return lambda found: max(values(found[key], name)) if key in found else None
