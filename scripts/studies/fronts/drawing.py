"""The figure of a front, its families of gaits directly labelled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, GREY = "#1f2933", "#7b8794"
COLOURS = {1: "#0f766e", 2: "#c2410c", 3: "#6d28d9"}

#: Gaits of one family are joined by a line if their speeds differ by less (m/s).
NEIGHBOURS = 0.11


def drawn(found: dict[str, Any]) -> Figure:
    """Cost of transport over speed: the front, its families, and where resting may pay."""
    figure = Figure(figsize=(10, 5.6), dpi=110, layout="constrained")
    axes = figure.subplots()
    front = found["front"]
    speeds, cots = [row["speed"] for row in front], [row["cot"] for row in front]
    families: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for row in (*front, *found["other_gaits"]):
        families.setdefault((row["steps"], row["turns"]), []).append(row)
    for (steps, turns), rows in sorted(families.items()):
        rows.sort(key=lambda row: row["speed"])
        for run in _runs(rows):
            x, y = [row["speed"] for row in run], [row["cot"] for row in run]
            axes.plot(x, y, ".-", color=COLOURS[steps], lw=1, ms=4, alpha=0.75)
        _label(axes, steps, turns, rows, front)
    axes.plot(speeds, cots, color=INK, lw=2.2, alpha=0.35, solid_capstyle="round", zorder=1)
    rests = [row["rest"] for row in front if row["rest"]]
    if rests:
        x, y = [rest["speed"] for rest in rests], [rest["cot"] for rest in rests]
        axes.plot(x, y, ":", color=INK, lw=1.2)
        axes.annotate(
            "walking faster, with rests (a bound)",
            *((x[0], y[0]), (4, -10)),
            textcoords="offset points",
            fontsize=8,
            color=INK,
        )
    axes.set(
        yscale="log",
        xlabel="speed (m/s)",
        ylabel="cost of transport (E+)",
        title=f"The front of {found['machine']}: families by steps and turns per stride",
    )
    axes.grid(alpha=0.25, which="both")
    for steps, colour in COLOURS.items():
        axes.plot([], [], ".-", color=colour, label=f"{steps} step{'s' * (steps > 1)} per stride")
    axes.plot([], [], color=INK, lw=2.2, alpha=0.35, label="front")
    axes.legend(frameon=False, loc="upper left", fontsize=8)
    return figure


def _runs(rows: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Rows in order of speed, parted where two neighbours are far from each other."""
    runs: list[list[dict[str, Any]]] = []
    for row in rows:
        if runs and row["speed"] - runs[-1][-1]["speed"] < NEIGHBOURS:
            runs[-1].append(row)
        else:
            runs.append([row])
    return runs


def _label(
    axes: Axes,
    steps: int,
    turns: int,
    rows: Sequence[dict[str, Any]],
    front: Sequence[dict[str, Any]],
) -> None:
    """The number of turns, at the family's cheapest gait on the front, or at its last gait."""
    best = {row["speed"]: row["cot"] for row in front}
    leading = [row for row in rows if row["cot"] <= best[row["speed"]]]
    if not leading and turns != 0:
        return
    at = min(leading, key=lambda row: row["cot"]) if leading else rows[len(rows) // 2]
    axes.annotate(
        f"{turns}" if turns else "swings (0)",
        (at["speed"], at["cot"]),
        textcoords="offset points",
        xytext=(0, -11 if leading else 7),
        ha="center",
        fontsize=8,
        color=COLOURS[steps],
    )
