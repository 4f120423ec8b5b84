"""All laws in one table: the first section of docs/feedback.md."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import fmean, median
from typing import Any

from scripts.studies.documents.markdown import table
from scripts.studies.feedback_laws.columns import TIMING
from scripts.studies.feedback_laws.figures import (
    NONE,
    Row,
    at,
    law_name,
    mean,
    percent,
    signed,
)


def summary(found: Mapping[str, Any]) -> str:
    """The table of all laws, in means over the gaits."""
    by_law: dict[str, list[Row]] = {}
    for rows in found["results"].values():
        for law, row in rows.items():
            by_law.setdefault(law, []).append(row)
    momenta = [gait["momentum"] for gait in found["gaits"].values()]
    head = [
        "law",
        "over the optimum",
        "starts that walk",
        "push backward",
        "push forward",
        "random states",
        "machines ± 20 %",
        "noise",
        "10 ms late",
        "slowest decay",
        "decision (µs)",
    ]
    body = [
        [
            law_name(law, found),
            signed(mean(at(row, "cost", "gap") for row in rows)),
            percent(mean(at(row, "cost", "share") for row in rows)),
            *(_least_push(rows, momenta, side) for side in ("backward", "forward")),
            percent(mean(at(row, "attraction", "share") for row in rows)),
            percent(mean(_machine_share(row) for row in rows)),
            *(
                percent(mean(at(row, "nuisances", "figures", name, "share") for row in rows))
                for name in ("noise x 1", "delay 1")
            ),
            _worst_multiplier(rows),
            _middle_time(rows),
        ]
        for law, rows in by_law.items()
    ]
    parts = [table(head, body)]
    if found["slow_laws"]:
        parts.append("\\* A slow law, measured from fewer starts, states and phases.")
    took = f"These figures took {found['minutes_of_one_core']:.0f} minutes of one core"
    parts.append(f"{took}{' in a trial' if found['quick'] else ''}.")
    return "\n\n".join(parts)


def _least_push(rows: list[Row], momenta: list[float], side: str) -> str:
    """The least over the phases, in units of the momentum, in the mean of the gaits."""
    shares = [
        min(pushes) / momentum
        for row, momentum in zip(rows, momenta, strict=True)
        if (pushes := at(row, "pushes", f"{side}_walking"))
    ]
    return f"{fmean(shares):.2f}" if shares else NONE


def _machine_share(row: Row) -> float | None:
    parameters = at(row, "machines", "parameters") or {}
    return mean(each["share"] for changes in parameters.values() for each in changes.values())


def _worst_multiplier(rows: list[Row]) -> str:
    known = [at(row, "multipliers", "closed_loop") for row in rows]
    if not all(known):
        return NONE
    return f"{max(each[0] for each in known):.2f}"


def _middle_time(rows: list[Row]) -> str:
    known = [time for row in rows if (time := at(row, TIMING, "batch")) is not None]
    return f"{1e6 * median(known):.1f}" if known else NONE
