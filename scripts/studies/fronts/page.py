"""The search's result as a section of docs/front.md."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rimless_gym.envs.task import Task
from rimless_gym.presets import as_params
from scripts.studies.documents.markdown import table
from trajopt.files import write_text


def marks(name: str) -> re.Pattern[str]:
    """What surrounds a machine's section."""
    begin, end = (re.escape(mark) for mark in _marks(name))
    return re.compile(f"({begin}\n).*?({end})", re.DOTALL)


def refresh(page: Path, found: dict[str, Any]) -> None:
    """Put a machine's section into a page, at its marks or else at the end."""
    name, text = found["machine"], page.read_text()
    if not marks(name).search(text):
        begin, end = _marks(name)
        text = f"{text.rstrip()}\n\n{begin}\n{end}\n"
    write_text(page, marks(name).sub(lambda m: m[1] + section(found) + m[2], text))


def figure_file(name: str) -> str:
    """The name of the figure beside the page."""
    return f"front_{name.lower()}.png"


def section(found: dict[str, Any]) -> str:
    """The section: figure, what the search did, and the table."""
    name, rows = found["machine"], found["front"]
    head = [
        "speed (m/s)",
        "CoT",
        "power (W)",
        "steps",
        "turns",
        "with rests",
        "friction demand",
        "clearance (m)",
        "seeds differ by",
        "found by",
    ]
    body = [_cells(row, found) for row in rows]
    parts = [
        f"## {name}",
        f"![The front of {name}]({figure_file(name)})",
        *_did(found),
        table(head, body),
    ]
    return "\n\n".join(parts) + "\n"


def _cells(row: dict[str, Any], found: dict[str, Any]) -> list[str]:
    rest, gaps = row["rest"], found["agreement"]["differences"]
    speed = f"{row['speed']:g}"
    apart = "" if speed not in gaps else "one found none"
    if gaps.get(speed) is not None:
        apart = f"{gaps[speed]:.2%}"
    return [
        f"{row['speed']:g}",
        f"{row['cot']:.5f}",
        f"{row['cot'] * row['speed'] * as_params(found['params']).weight:.3g}",
        str(row["steps"]),
        f"{row['turns']:d}",
        "" if rest is None else f"{rest['cot']:.5f}, walking at {rest['walking']:g}",
        f"{row['friction_demand']:.2f}",
        f"{row['clearance']:.3f}",
        apart,
        row["found_by"],
    ]


def _did(found: dict[str, Any]) -> list[str]:
    rows, minutes, wanted = found["front"], found["minutes"], found["agreement"]["wanted"]
    gaps = found["agreement"]["differences"]
    apart = [v for v, gap in gaps.items() if gap is None or gap > wanted]
    largest = max((gap for gap in gaps.values() if gap is not None), default=0.0)
    (one, other), last = found["seeds"], found["last_sweep"]
    resting = [row for row in rows if row["rest"]]
    texts = [
        f"Walks were found from {rows[0]['speed']:g} to {rows[-1]['speed']:g} m/s, at "
        f"{len(rows)} speeds. The two seeds made {one['random_starts']} and "
        f"{other['random_starts']} random starts, of which {one['became_gaits']} and "
        f"{other['became_gaits']} became gaits, and led or joined {one['led_or_joined']} and "
        f"{other['led_or_joined']} gaits. The last sweep made {last['random_starts']} starts.",
        _agreement(apart, largest, wanted, len(gaps)),
        _swept(found["last_sweeps"]),
        _earned(rows, Task().distance_weight),
        f"It took {minutes['search_of_one_core']:.0f} minutes of one core to search, and "
        f"{minutes['fine_meshes_of_one_core']:.0f} to solve the gaits on fine meshes and to verify "
        f"them, of a budget of {minutes['budget']:g} minutes of {minutes['workers']} processes.",
    ]
    if found["speeds_without_verified_gait"]:
        speeds = ", ".join(f"{v:g}" for v in found["speeds_without_verified_gait"])
        texts.append(f"No gait at {speeds} m/s passed verification, or time was up before.")
    if resting:
        texts.append(f"Resting may pay at {len(resting)} of the speeds: see the column with rests.")
    return texts


def _earned(rows: Sequence[dict[str, Any]], price: float) -> str:
    """Which of the gaits earns most reward, and how it compares with its neighbours."""
    rates = {row["speed"]: (price - row["cot"]) * row["speed"] for row in rows}
    best = max(rates, key=lambda speed: rates[speed])
    slower = [f"{rates[v] / rates[best]:.1%} of that at {v:g} m/s" for v in rates if v < best][-3:]
    return (
        f"At the environment's price of distance, {price:g}, of these walks that at {best:g} m/s "
        f"earns most, {rates[best]:.4f} m per second. Slower walks earn less: {', '.join(slower)}."
    )


def _agreement(apart: Sequence[str], largest: float, wanted: float, count: int) -> str:
    if not apart:
        return f"**The two seeds agree within {max(largest, 1e-4):.2%} at all {count} speeds.**"
    return (
        f"**The two seeds do not agree yet:** at {len(apart)} of {count} speeds their costs differ "
        f"by more than {wanted:.1%} ({', '.join(apart)} m/s)."
    )


def _swept(sweeps: Sequence[dict[str, Any]]) -> str:
    texts = []
    for i, sweep in enumerate(sweeps, start=1):
        better = "found nothing better"
        if sweep["gain"] > 1e-4:
            better = (
                f"lowered the cost at {sweep['speed']:g} m/s by {sweep['gain']:.2%}, and "
                "elsewhere less"
            )
        if sweep["gain"] == 1.0:
            better = f"found a gait at {sweep['speed']:g} m/s, where there was none"
        cut = "" if sweep["complete"] else " before time was up"
        texts.append(f"Last sweep {i} {better}{cut}.")
    return " ".join(texts)


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- front of {name} -->", f"<!-- end of front of {name} -->"
