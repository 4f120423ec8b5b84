"""All laws about one gait: a section of docs/feedback.md."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median
from typing import Any

from scripts.studies.documents.markdown import table
from scripts.studies.feedback_laws import drawing
from scripts.studies.feedback_laws.columns import TIMING
from scripts.studies.feedback_laws.columns.pushes import Survived
from scripts.studies.feedback_laws.figures import (
    NONE,
    Row,
    at,
    law_name,
    measured_columns,
    micro,
    multipliers_text,
    number,
    percent,
    signed,
    walk,
    with_interval,
)

#: Names of the nuisances in the page.
NUISANCES = {
    "undisturbed": "undisturbed",
    "noise x 1": "noise",
    "noise x 2": "noise, times 2",
    "noise x 4": "noise, times 4",
    "delay 1": "10 ms late",
    "delay 2": "20 ms late",
    "sag": "70 % of every voltage",
    "limit": "at most 70 % of the limit",
}


def gait_section(key: str, found: Mapping[str, Any]) -> list[str]:
    """Its tables and pictures, as paragraphs."""
    gait, rows = found["gaits"][key], found["results"][key]
    names = {law: law_name(law, found) for law in rows}
    turns = -gait["turns"]
    return [
        f"### {gait['preset']} at {gait['asked_speed']:g} m/s",
        f"The held gait walks at {gait['speed']:.4f} m/s with a CoT of {gait['cot']:.5f}. Its "
        f"stride has {gait['steps']} step{'s' if gait['steps'] != 1 else ''} and {turns} forward "
        f"turn{'s' if turns != 1 else ''} of the pendulum. Its friction demand is "
        f"{gait['friction_demand']:.2f}, of {gait['friction']:g} that the ground gives, and its "
        f"least normal force {gait['least_force']:.2f} of the weight.",
        _costs({names[law]: row for law, row in rows.items()}),
        pushes_table({names[law]: row for law, row in rows.items()}),
        f"![Random states about {key}]({drawing.attraction_file(key)})",
        f"![Pushes about {key}]({drawing.pushes_file(key)})",
        nuisances_table({names[law]: row for law, row in rows.items()}),
        machines_table({names[law]: row for law, row in rows.items()}),
        _multipliers({names[law]: row for law, row in rows.items()}),
    ]


def _costs(rows: Mapping[str, Row]) -> str:
    head = [
        "law",
        "over the optimum (95 %)",
        "speed (m/s)",
        "starts that walk (95 %)",
        "friction demand",
        "at touchdowns",
        "least Fy / weight",
        "one decision (µs)",
        "in a batch (µs)",
    ]
    body = []
    for name, row in rows.items():
        cost, timing = row["cost"] or {}, row[TIMING] or {}
        body.append(
            [
                name,
                with_interval(cost, "gap", signed),
                number(cost.get("speed"), 4),
                with_interval(cost, "share", percent),
                number(cost.get("friction_demand"), 2),
                number(cost.get("impulse_friction_demand"), 2),
                number(cost.get("least_force"), 2),
                *(number(micro(timing.get(each)), 1) for each in ("single", "batch")),
            ]
        )
    return table(head, body)


def pushes_table(rows: Mapping[str, Row]) -> str:
    """Pushes, random states and slopes that each law or policy survives, by its name."""
    head = [
        "law",
        "push backward (N s): least, median, most",
        "steps again after",
        "push forward (N s)",
        "steps again after",
        "random states that walk",
        "caught after (s), median",
        "slopes held (deg)",
    ]
    body = []
    for name, row in rows.items():
        attraction, slopes = row["attraction"] or {}, row["slopes"] or {}
        sides = [
            _push(row["pushes"] or {}, f"{side}_{kind}")
            for side in ("backward", "forward")
            for kind in Survived._fields
        ]
        body.append(
            [
                name,
                *sides,
                percent(attraction.get("share")),
                number(attraction.get("median_time"), 1),
                _slopes(slopes),
            ]
        )
    return table(*measured_columns(head, body))


def _push(pushes: Mapping[str, Any], side: str) -> str:
    if side not in pushes:
        return NONE
    values, most = pushes[side], pushes["largest_tried"]
    return ", ".join(
        f"≥ {value:.2f}" if value >= most else f"{value:.2f}"
        for value in (min(values), median(values), max(values))
    )


def _slopes(slopes: Mapping[str, Any]) -> str:
    up, down = slopes.get("up"), slopes.get("down")
    if up is None or down is None:
        return NONE
    return f"{up:g} up to {down:g} down"


def nuisances_table(rows: Mapping[str, Row]) -> str:
    """Walks under noise, delay and a low battery, by the name of the law or policy."""
    body = []
    for name, row in rows.items():
        figures, starts = at(row, "nuisances", "figures") or {}, at(row, "nuisances", "starts")
        body.append([name, *(walk(figures.get(each), starts) for each in NUISANCES)])
    return table(["law: walking, CoT", *NUISANCES.values()], body)


def machines_table(rows: Mapping[str, Row]) -> str:
    """Walks on other machines, by the name of the law or policy."""
    every = {name: row["machines"] or {} for name, row in rows.items()}
    changes = {
        (parameter, change): None
        for machines in every.values()
        for parameter, by_change in machines.get("parameters", {}).items()
        for change in by_change
    }
    body = [
        [
            f"`{parameter}` {change}",
            *(
                walk(at(machines, "parameters", parameter, change), machines.get("starts"))
                for machines in every.values()
            ),
        ]
        for parameter, change in changes
    ]
    return table(["machine: walking, CoT", *every], body)


def _multipliers(rows: Mapping[str, Row]) -> str:
    known = [row["multipliers"] for row in rows.values() if row["multipliers"]]
    body = []
    if known:
        body += [
            ["none, voltage by the clock", multipliers_text(known[0]["open_loop"]), NONE],
            ["none, voltage from touchdown", multipliers_text(known[0]["touchdowns_switch"]), NONE],
        ]
    for name, row in rows.items():
        own = row["multipliers"] or {}
        body.append([name, multipliers_text(own.get("closed_loop")), number(own.get("decay"), 3)])
    return table(["law by itself", "multipliers", "measured decay per stride"], body)
