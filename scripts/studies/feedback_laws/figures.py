"""Figures as the tables of docs/feedback.md write them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import compress
from statistics import fmean
from typing import Any

from agents.outcomes import FALLS, STOPS

#: For a figure that is missing: the law does not walk there, or could not be measured.
NONE = "-"

#: The results of a law about a gait, by column.
Row = Mapping[str, Any]


def law_name(law: str, found: Mapping[str, Any]) -> str:
    """Its name, with a star if it is slow."""
    return f"`{law}`" + (r" \*" if law in found["slow_laws"] else "")


def at(row: Row | None, *keys: str) -> Any:
    """The value under keys one after the other; None where one is missing."""
    value: Any = row
    for key in keys:
        value = None if value is None else value.get(key)
    return value


def mean(values: Iterable[float | None]) -> float | None:
    """Mean of the values that are known; None if none is."""
    known = [value for value in values if value is not None]
    return fmean(known) if known else None


def percent(value: float | None) -> str:
    """A share."""
    return NONE if value is None else f"{100 * value:.0f} %"


def signed(value: float | None) -> str:
    """A share with its sign."""
    return NONE if value is None else f"{100 * value:+.2f} %"


def number(value: float | None, digits: int) -> str:
    """With so many digits."""
    return NONE if value is None else f"{value:.{digits}f}"


def measured_columns(head: list[str], body: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """The head and the lines of a table without the columns that tell nothing of any line."""
    kept = [any(line[i] != NONE for line in body) for i in range(len(head))]
    return list(compress(head, kept)), [list(compress(line, kept)) for line in body]


def micro(seconds: float | None) -> float | None:
    """In microseconds."""
    return None if seconds is None else 1e6 * seconds


def with_interval(cost: Mapping[str, Any], name: str, text: Any) -> str:
    """A mean and its interval."""
    interval = cost.get(f"{name}_interval")
    if interval is None:
        return NONE
    low, high = (text(end).removesuffix(" %") for end in interval)
    return f"{text(cost[name])} ({low} to {high})"


def walk(figures: Mapping[str, Any] | None, starts: int | None) -> str:
    """The share that walks, more that only take steps in brackets, and the CoT."""
    if figures is None or starts is None:
        return NONE
    faults = figures["faults"]
    steps = 1.0 - (faults.get(FALLS, 0) + faults.get(STOPS, 0)) / starts
    share = percent(figures["share"])
    if steps > figures["share"] + 1e-9:
        share += f" ({percent(steps)})"
    return share if figures["cot"] is None else f"{share}, {figures['cot']:.4f}"


def multipliers_text(multipliers: list[float] | None) -> str:
    """Multipliers, one after the other."""
    if multipliers is None:
        return NONE
    return ", ".join(f"{each:.3g}" for each in multipliers)
