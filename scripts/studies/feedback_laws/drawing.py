"""Pictures: random states that are caught or not, and pushes by phase of the step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.policies import law_title
from scripts.studies.documents.drawings import GREY, INK

#: Most panels beside each other.
ACROSS = 3

#: From this time on (s), the colour is the same.
LATE = 5.0


def attraction_file(gait: str) -> str:
    """The name of the picture of random states."""
    return f"feedback_states_{gait}.png"


def pushes_file(gait: str) -> str:
    """The name of the picture of pushes."""
    return f"feedback_pushes_{gait}.png"


def figures(found: Mapping[str, Any]) -> dict[str, Figure]:
    """All pictures by the names of their files."""
    drawn = {}
    for gait, rows in found["results"].items():
        drawn[attraction_file(gait)] = attraction(rows)
        drawn[pushes_file(gait)] = pushes(rows)
    return drawn


def attraction(rows: Mapping[str, Any]) -> Figure:
    """phi' over theta' of the random states, coloured by how fast they are caught."""
    across = min(ACROSS, len(rows))
    down = -(-len(rows) // across)
    figure, panels = plt.subplots(
        *(down, across),
        figsize=(3.3 * across + 1.2, 3.1 * down),
        dpi=100,
        layout="constrained",
        squeeze=False,
        sharex=True,
        sharey=True,
    )
    points = None
    for axes, (law, row) in zip(panels.flat, rows.items(), strict=False):
        axes.set_title(law_title(law), fontsize=10)
        if row["attraction"]:
            points = _states(axes, row["attraction"])
    for axes in panels.flat[len(rows) :]:
        axes.set_axis_off()
    figure.supxlabel(r"pendulum $\dot\theta$ (rad/s)", fontsize=10)
    figure.supylabel(r"leg $\dot\varphi$ (rad/s)", fontsize=10)
    if points is not None:
        figure.colorbar(points, ax=panels, label="caught after (s)", extend="max")
    return figure


def _states(axes: Axes, found: Mapping[str, Any]) -> Any:
    rates, walking = np.array(found["rates"]), np.array(found["walking"])
    times = np.array([np.nan if t is None else t for t in found["times"]], dtype=float)
    caught = np.isfinite(times)
    lost, beside = ~walking, walking & ~caught
    axes.plot(rates[lost, 1], rates[lost, 0], "x", color=GREY, ms=3.5, mew=0.8, alpha=0.7)
    axes.plot(rates[beside, 1], rates[beside, 0], "o", mfc="none", color=INK, ms=4, mew=0.8)
    axes.grid(alpha=0.2)
    return axes.scatter(
        rates[caught, 1],
        rates[caught, 0],
        c=times[caught],
        s=13,
        cmap="viridis_r",
        vmin=0.0,
        vmax=LATE,
    )


def pushes(rows: Mapping[str, Any]) -> Figure:
    """The largest impulse that is survived over the phase, forward up and backward down.

    Full lines: the wheel walks by the rules again; dotted ones: it takes steps again.
    """
    figure, axes = plt.subplots(figsize=(6.6, 3.4), dpi=100, layout="constrained")
    for k, (law, row) in enumerate(rows.items()):
        found = row["pushes"]
        if not found:
            continue
        for side, sign in (("forward", 1.0), ("backward", -1.0)):
            for kind, style in (("walking", "o-"), ("stepping", ".:")):
                axes.plot(
                    found["phases"],
                    sign * np.array(found[f"{side}_{kind}"]),
                    style,
                    color=f"C{k}",
                    ms=4,
                    lw=1.2,
                    label=law_title(law) if (sign, kind) == (1.0, "walking") else None,
                )
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.set(
        xlim=(0, 1), xlabel="phase of the stride (share of its time)", ylabel="largest push (N s)"
    )
    axes.grid(alpha=0.25)
    if any(row["pushes"] for row in rows.values()):
        axes.legend(frameon=False, fontsize=8, ncols=3)
    return figure
