"""The study's results as JSON, as a figure, and as a table for a page."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from scripts.studies.documents import markdown
from scripts.studies.thesis.prototype.ends import End
from scripts.studies.thesis.prototype.points import Point
from scripts.studies.thesis.prototype.variant import SCALES
from trajopt.provenance import provenance

MARKS = re.compile(r"(<!-- prototype -->\n).*?(<!-- end of prototype -->)", re.DOTALL)

#: What a page must contain, in words.
WANTED = "<!-- prototype --> and <!-- end of prototype -->"

#: Limits that a gait reaches for a smaller share of its time are not named.
LEAST_SHARE = 0.005

COLUMNS = (
    *("supply", "scale", "CoT", "speed (m/s)", "turns", "gear", "least Fy / weight"),
    *("friction demand", "peak V", "clearance (m)", "state error", "at its limit"),
)


def figures_of(page: Path) -> Path:
    """The folder beside a page that figures, results and gaits are put into."""
    return page.parent / "figures" / "prototype"


def results(points: Sequence[Point], ends: Sequence[End]) -> dict[str, Any]:
    """Everything as plain JSON values."""
    return {
        "gaits": [point.row() for point in points],
        "ends": [
            {
                "variant": end.variant,
                "scales": list(end.scales),
                "costs": list(end.costs),
                "obstacle": end.obstacle,
            }
            for end in ends
        ],
        "provenance": provenance(),
    }


def write(found: dict[str, Any], folder: Path) -> None:
    """Write ``results.json`` and ``prototype.png`` into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(found, indent=1, allow_nan=False) + "\n")
    story(found).savefig(folder / "prototype.png", dpi=80)


def refresh(page: Path, found: dict[str, Any], points: Sequence[Point]) -> None:
    """Put the table into a page, and the rest into ``figures/prototype`` beside it.

    The rest includes files of the gaits of the machine as built.
    """
    folder = figures_of(page)
    write(found, folder)
    for point in points:
        if point.gait is not None and point.scale == SCALES[-1]:
            point.gait.save(folder / f"as_built_{point.variant.file_name}.npz")
    text = page.read_text()
    page.write_text(MARKS.sub(lambda marks: marks[1] + table(found) + marks[2], text))


def story(found: dict[str, Any]) -> Figure:
    """Cost of transport, speed and clearance against the pendulum's scale."""
    figure = Figure(figsize=(10, 7), layout="constrained")
    panels = figure.subplot_mosaic([["cot", "cot"], ["speed", "clearance"]])
    labels = {
        "cot": "cost of transport (E+)",
        "speed": "speed (m/s)",
        "clearance": "pendulum's clearance (m)",
    }
    for color, name in zip(("C0", "C1", "C2"), _names(found), strict=False):
        rows = [row for row in found["gaits"] if row["variant"] == name and row["cot"] is not None]
        for key, panel in panels.items():
            scales = [row["scale"] for row in rows]
            panel.plot(scales, [row[key] for row in rows], "o-", ms=4, color=color, label=name)
        for end in found["ends"]:
            if end["variant"] == name and end["scales"]:
                panels["cot"].plot(end["scales"], end["costs"], ":", color=color)
                panels["cot"].plot(end["scales"][-1], end["costs"][-1], "x", ms=9, color=color)
    for key, panel in panels.items():
        panel.set_ylabel(labels[key])
        panel.axvline(1.0, color="0.6", lw=0.8)
        panel.invert_xaxis()
        panel.grid(alpha=0.3)
    panels["cot"].set_yscale("log")
    panels["cot"].set_title(
        "Can the machine as built (1) walk? Pendulum's mass and length, in those as built"
    )
    panels["cot"].legend()
    panels["clearance"].axhline(0.0, color="k", lw=0.8)
    return figure


def _names(found: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(row["variant"] for row in found["gaits"]))


def table(found: dict[str, Any]) -> str:
    """A row per gait, and a line on how the gaits of each supply end."""
    lines = [markdown.table(COLUMNS, map(_cells, found["gaits"])), ""]
    for end in found["ends"]:
        last = f"{end['scales'][-1]:.3f}" if end["scales"] else "the first solution"
        lines.append(
            f"- **{end['variant']}**: the last verified gait, followed on a coarse mesh, goes on "
            f"to scale {last} (CoT {end['costs'][-1]:.2f}), where it stops {end['obstacle']}."
        )
    return "\n".join(lines) + "\n"


def _cells(row: dict[str, Any]) -> list[str]:
    if row["cot"] is None:
        return [row["variant"], f"{row['scale']:g}", "no gait found", *["-"] * 9]
    shares = row["binding"]
    limits = [f"{name} {share:.0%}" for name, share in shares.items() if share > LEAST_SHARE]
    return [
        row["variant"],
        f"{row['scale']:g}",
        f"{row['cot']:.4f}",
        f"{row['speed']:.3f}",
        f"{row['theta_turns']:d}",
        f"{row['gear']:.3f}",
        f"{row['min_normal_force_over_weight']:.2f}",
        f"{row['max_friction_demand']:.2f}",
        f"{row['peak_voltage']:.1f}",
        f"{row['clearance']:.2f}",
        f"{row['state_error']:.0e}",
        ", ".join(limits) or "-",
    ]
