"""The study's figures: cost of transport over gear and legs, and over the pendulum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from rimless_gym.presets import BUILDABLE
from scripts.studies.codesign.problem import chosen

#: The dearest cost of transport that is drawn: no build with 62 : 1 is as cheap.
DEAREST = 0.15


def landscape(rows: Sequence[dict[str, Any]]) -> Figure:
    """Cost of transport and largest open-loop multiplier, over gear ratio by number of legs."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for legs in sorted({row["legs"] for row in rows}):
        own = sorted((r for r in rows if r["legs"] == legs), key=lambda r: float(r["ratio"]))
        own = [row for row in own if row["cot"] < DEAREST]
        ratios = [row["ratio"] for row in own]
        left.plot(ratios, [row["cot"] for row in own], "o-", ms=4, label=f"{legs} legs")
        right.plot(ratios, [row["multiplier"] for row in own], "o-", ms=4, label=f"{legs} legs")
    left.set_ylabel("least cost of transport, all power")
    right.set_ylabel("largest open-loop multiplier")
    right.set_yscale("log")
    for panel in (left, right):
        panel.set_xlabel("gear ratio")
        panel.set_xscale("log")
        panel.set_xticks([16, 21, 28, 35], labels=["16", "21", "28", "35"])
        panel.xaxis.minorticks_off()
        panel.grid(alpha=0.3)
    left.legend()
    figure.suptitle("The cheapest gait of every build: bob, arm and speed chosen with it")
    return figure


def pendulums(rows: Sequence[dict[str, Any]]) -> Figure:
    """Cost of transport and start-up over the bob's mass and the arm's length, where one walks."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    bob = [row["bob"] for row in rows]
    arm = [1000 * row["arm"] for row in rows]
    cot, joined = ([row[name] for row in rows] for name in ("cot", "joined"))
    costs = left.scatter(arm, bob, c=cot, s=900, marker="s", cmap="viridis_r")
    shares = right.scatter(arm, bob, c=joined, s=900, marker="s", vmin=0, vmax=1)
    for panel, values, form in ((left, cot, ".3f"), (right, joined, ".0%")):
        for value, x, y in zip(values, arm, bob, strict=True):
            box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
            panel.annotate(f"{value:{form}}", (x, y), ha="center", va="center", size=7, bbox=box)
    own = chosen(BUILDABLE)
    for panel in (left, right):
        panel.plot(1000 * own[1], own[0], "rs", ms=33, mfc="none", mew=2)
        panel.set_xlabel("arm (mm)")
        panel.margins(0.15)
    left.set_ylabel("bob (kg)")
    figure.colorbar(costs, ax=left, label="least cost of transport")
    figure.colorbar(shares, ax=right, label="in the gait within 10 s")
    figure.suptitle(
        f"Pendulums on the build of BUILDABLE ({BUILDABLE.n_legs} legs); framed: its own"
    )
    return figure
