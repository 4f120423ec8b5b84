"""The study's results as sections of docs/feedback.md."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

from agents.verdicts import FALLS, STOPS
from scripts.documents.tables import table
from scripts.feedback_laws import drawing
from scripts.feedback_laws.columns import TIMING
from scripts.feedback_laws.columns.pushes import Survived
from trajopt.files import write_text

SECTIONS = ("summary", "gaits")
MARKS = {
    name: re.compile(rf"(<!-- feedback: {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    for name in SECTIONS
}

#: What a page must contain, in words.
WANTED = ", ".join(f"<!-- feedback: {n} --> and <!-- end of {n} -->" for n in SECTIONS)

#: For a figure that is missing: the law does not walk there, or could not be measured.
NONE = "-"

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

#: The results of a law about a gait, by column.
Row = Mapping[str, Any]


def refresh(page: Path, found: Mapping[str, Any]) -> None:
    """Put every section between its marks."""
    text = page.read_text()
    for name, section in sections(found).items():
        text = MARKS[name].sub(partial(_between, section), text)
    write_text(page, text)


def _between(section: str, marks: re.Match[str]) -> str:
    return marks[1] + section + marks[2]


def sections(found: Mapping[str, Any]) -> dict[str, str]:
    """All sections by name."""
    gaits = [_gait(key, found) for key in found["gaits"]]
    return {
        "summary": _summary(found) + "\n",
        "gaits": "\n\n".join(["\n\n".join(parts) for parts in gaits]) + "\n",
    }


# -- the summary ----------------------------------------------------------------------------------


def _summary(found: Mapping[str, Any]) -> str:
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
            _law(law, found),
            _signed(_mean(_at(row, "cost", "gap") for row in rows)),
            _percent(_mean(_at(row, "cost", "share") for row in rows)),
            *(_least_push(rows, momenta, side) for side in ("backward", "forward")),
            _percent(_mean(_at(row, "attraction", "share") for row in rows)),
            _percent(_mean(_machine_share(row) for row in rows)),
            *(
                _percent(_mean(_at(row, "nuisances", "figures", name, "share") for row in rows))
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
        if (pushes := _at(row, "pushes", f"{side}_walking"))
    ]
    return f"{fmean(shares):.2f}" if shares else NONE


def _machine_share(row: Row) -> float | None:
    parameters = _at(row, "machines", "parameters") or {}
    return _mean(each["share"] for changes in parameters.values() for each in changes.values())


def _worst_multiplier(rows: list[Row]) -> str:
    known = [_at(row, "multipliers", "closed_loop") for row in rows]
    if not all(known):
        return NONE
    return f"{max(each[0] for each in known):.2f}"


def _middle_time(rows: list[Row]) -> str:
    known = [time for row in rows if (time := _at(row, TIMING, "batch")) is not None]
    return f"{1e6 * median(known):.1f}" if known else NONE


# -- a gait ---------------------------------------------------------------------------------------


def _gait(key: str, found: Mapping[str, Any]) -> list[str]:
    gait, rows = found["gaits"][key], found["results"][key]
    names = {law: _law(law, found) for law in rows}
    turns = -gait["turns"]
    return [
        f"### {gait['preset']} at {gait['asked_speed']:g} m/s",
        f"The held gait walks at {gait['speed']:.4f} m/s with a CoT of {gait['cot']:.5f}. Its "
        f"stride has {gait['steps']} step{'s' if gait['steps'] != 1 else ''} and {turns} forward "
        f"turn{'s' if turns != 1 else ''} of the pendulum. Its friction demand is "
        f"{gait['friction_demand']:.2f}, of {gait['friction']:g} that the ground gives, and its "
        f"least normal force {gait['least_force']:.2f} of the weight.",
        _costs({names[law]: row for law, row in rows.items()}),
        _pushes({names[law]: row for law, row in rows.items()}),
        f"![Random states about {key}]({drawing.attraction_file(key)})",
        f"![Pushes about {key}]({drawing.pushes_file(key)})",
        _nuisances({names[law]: row for law, row in rows.items()}),
        _machines({names[law]: row for law, row in rows.items()}),
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
                _with_interval(cost, "gap", _signed),
                _number(cost.get("speed"), 4),
                _with_interval(cost, "share", _percent),
                _number(cost.get("friction_demand"), 2),
                _number(cost.get("impulse_friction_demand"), 2),
                _number(cost.get("least_force"), 2),
                *(_number(_micro(timing.get(each)), 1) for each in ("single", "batch")),
            ]
        )
    return table(head, body)


def _pushes(rows: Mapping[str, Row]) -> str:
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
                _percent(attraction.get("share")),
                _number(attraction.get("median_time"), 1),
                _slopes(slopes),
            ]
        )
    return table(head, body)


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


def _nuisances(rows: Mapping[str, Row]) -> str:
    body = []
    for name, row in rows.items():
        figures, starts = _at(row, "nuisances", "figures") or {}, _at(row, "nuisances", "starts")
        body.append([name, *(_walk(figures.get(each), starts) for each in NUISANCES)])
    return table(["law: walking, CoT", *NUISANCES.values()], body)


def _machines(rows: Mapping[str, Row]) -> str:
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
                _walk(_at(machines, "parameters", parameter, change), machines.get("starts"))
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
            ["none, voltage by the clock", _four(known[0]["open_loop"]), NONE],
            ["none, voltage from touchdown", _four(known[0]["touchdowns_switch"]), NONE],
        ]
    for name, row in rows.items():
        own = row["multipliers"] or {}
        body.append([name, _four(own.get("closed_loop")), _number(own.get("decay"), 3)])
    return table(["law by itself", "multipliers", "measured decay per stride"], body)


# -- cells ----------------------------------------------------------------------------------------


def _law(law: str, found: Mapping[str, Any]) -> str:
    return f"`{law}`" + (r" \*" if law in found["slow_laws"] else "")


def _at(row: Row | None, *keys: str) -> Any:
    """The value under keys one after the other; None where one is missing."""
    value: Any = row
    for key in keys:
        value = None if value is None else value.get(key)
    return value


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if known else None


def _percent(value: float | None) -> str:
    return NONE if value is None else f"{100 * value:.0f} %"


def _signed(value: float | None) -> str:
    return NONE if value is None else f"{100 * value:+.2f} %"


def _number(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def _micro(seconds: float | None) -> float | None:
    return None if seconds is None else 1e6 * seconds


def _with_interval(cost: Mapping[str, Any], name: str, text: Any) -> str:
    interval = cost.get(f"{name}_interval")
    if interval is None:
        return NONE
    low, high = (text(end).removesuffix(" %") for end in interval)
    return f"{text(cost[name])} ({low} to {high})"


def _walk(figures: Mapping[str, Any] | None, starts: int | None) -> str:
    """The share that walks, more that only take steps in brackets, and the CoT."""
    if figures is None or starts is None:
        return NONE
    faults = figures["faults"]
    steps = 1.0 - (faults.get(FALLS, 0) + faults.get(STOPS, 0)) / starts
    share = _percent(figures["share"])
    if steps > figures["share"] + 1e-9:
        share += f" ({_percent(steps)})"
    return share if figures["cot"] is None else f"{share}, {figures['cot']:.4f}"


def _four(multipliers: list[float] | None) -> str:
    if multipliers is None:
        return NONE
    return ", ".join(f"{each:.3g}" for each in multipliers)
