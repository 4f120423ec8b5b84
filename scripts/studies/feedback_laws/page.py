"""The study's results in docs/feedback.md: a table of laws for each gait."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import fmean
from typing import Any

from scripts.studies.documents import markdown

MARKS = markdown.marks("feedback", ("gaits",))

#: The columns, and how each is written from the results of a law about a gait.
COLUMNS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "over the optimum (95 %)": lambda row: _interval(row["cost"], "gap", "+.2f"),
    "starts that walk (95 %)": lambda row: _interval(row["cost"], "share", ".0f"),
    "friction demand": lambda row: f"{row['cost']['friction_demand']:.2f}",
    "push backward (N s)": lambda row: f"{min(row['pushes']['backward']):.2f}",
    "push forward (N s)": lambda row: f"{min(row['pushes']['forward']):.2f}",
    "random states": lambda row: _percent(row["random_states"]["share"]),
    "noise": lambda row: _percent(row["disturbed"]["noise"]),
    "10 ms late": lambda row: _percent(row["disturbed"]["delay"]),
    "machines ± 20 %": lambda row: _percent(fmean(row["machines"].values())),
    "multiplier": lambda row: f"{row['multipliers']['sizes'][0]:.2f}",
    "decision (µs)": lambda row: f"{1e6 * row['decision']['batch']:.1f}",
}


def refresh(page: Path, results: Mapping[str, Any]) -> None:
    """Put the tables between their marks."""
    markdown.refresh(page, MARKS, {"gaits": tables(results) + "\n"})


def tables(results: Mapping[str, Any]) -> str:
    """A table of all laws for each gait."""
    parts = []
    for gait, rows in results.items():
        body = [
            [f"`{law}`", *(_cell(write, row) for write in COLUMNS.values())]
            for law, row in rows.items()
        ]
        parts.append(f"### {gait}\n\n{markdown.table(['law', *COLUMNS], body)}")
    return "\n\n".join(parts)


def _cell(write: Callable[[Mapping[str, Any]], str], row: Mapping[str, Any]) -> str:
    """A figure; a dash where the law does not walk, has none, or could not be measured."""
    try:
        return write(row)
    except (KeyError, TypeError):
        return "-"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _interval(cost: Mapping[str, Any], name: str, form: str) -> str:
    """A mean and its interval, in percent."""
    low, high = cost[f"{name}_interval"]
    return f"{100 * cost[name]:{form}} % ({100 * low:{form}} to {100 * high:{form}})"
