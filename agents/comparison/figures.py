"""The plots and the HTML report of a comparison."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from agents.comparison.study import Setting
from agents.comparison.table import COLUMNS, FRONT_POLICY, NOTES, Row, distinct
from agents.learner import CLONE, IMITATION
from agents.page import page
from agents.reports import COLOURS, STYLE, document, embedded, paragraph, section, table
from rimless_gym.presets import machine_name
from trajopt.gaits.fronts import CotFront, NoFrontError
from trajopt.store import write_text

#: Policies with a smaller gap are in the plot of gaps.
NEAR = 0.1

#: Markers of policies with the same colour.
MARKERS = "osD^vP*X"

#: The abscissae of learning curves: entries of a milestone, and their labels.
ACROSS = {
    "intervals": "control intervals of training",
    "minutes": "minutes of one core, those of what it began from included",
}


#: Milestones of a training (`agents.training.Milestone`) as plain values, in order.
Curve: TypeAlias = Sequence[Mapping[str, Any]]

LEAD = (
    "Optimal gaits, feedback laws that hold them, and policies learned on the same model, all "
    "measured in the same way. The machine: {machine}. Click a heading to sort."
)


def write_figures(
    setting: Setting,
    rows: Sequence[Row],
    curves: Mapping[str, Curve],
) -> None:
    """Write the plots, report.html, and page.html where the machine has one, into the folder.

    `curves` are the milestones of trainings, by their names.
    """
    out = setting.out
    with matplotlib.rc_context(STYLE):
        drawn = {
            "cot_against_speed": speed_figure(setting.front, setting.held_front, rows),
            "learning_curves": learning_figure(curves, setting.held_front),
        }
    images = {name: embedded(figure, name.replace("_", " ")) for name, figure in drawn.items()}
    for name, figure in drawn.items():
        figure.savefig(out / f"{name}.png", dpi=150)
        plt.close(figure)
    listed = [dataclasses.asdict(row) for row in distinct(rows)]
    parts = [
        section("Learned against optimal", table(COLUMNS, listed), paragraph(NOTES)),
        section("On the front", images["cot_against_speed"]),
        section("How they learned", images["learning_curves"]),
    ]
    lead = LEAD.format(machine=machine_name(setting.params))
    text = document("Learned against optimal walking", lead, parts, _page(out))
    write_text(out / "report.html", text)


def _page(folder: Path) -> str | None:
    """Write the page with the study's own clone, beside the report; return the file's name."""
    try:
        text = page(folder / IMITATION / CLONE)
    except NoFrontError:
        return None
    write_text(folder / "page.html", text)
    return "page.html"


def speed_figure(front: CotFront, held: CotFront, rows: Iterable[Row]) -> Figure:
    """Cost of transport over speed of all that walk, and the gaps of those near to the optimum.

    Gaps are those to the front of held gaits. Gaits on the fronts themselves are left out.
    """
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(9.0, 8.8), sharex=True, layout="constrained"
    )
    slowest, fastest = held.envelope[0].speed, held.envelope[-1].speed
    for of, line, name in ((front, "--", "continuous"), (held, "-", "held")):
        speeds = np.array([gait.speed for gait in of.envelope])
        cots = np.array([gait.cot for gait in of.envelope])
        shared = (slowest - 1e-9 <= speeds) & (speeds <= fastest + 1e-9)
        gaps = 100.0 * (cots[shared] / held(speeds[shared]) - 1.0)
        name = f"optimal, voltage {name}"
        above.plot(speeds, cots, line, color=COLOURS["ink"], label=name)
        below.plot(speeds[shared], gaps, line, color=COLOURS["ink"], label=name)
    walking = [row for row in rows if row.walking_share and row.cot is not None]
    gaits = [row for row in rows if row.walking_share is None and row.cot and not _near(row)]
    _plot_rows(above, [*walking, *gaits], "cot", 1.0)
    _plot_rows(below, list(filter(_near, walking)), "gap", 100.0)
    above.set(yscale="log", ylabel="cost of transport (E+, no regeneration)")
    above.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    above.yaxis.set_major_formatter("{x:g}")
    above.minorticks_off()
    below.set(xlabel="speed (m/s)", ylabel="gap to the optimum (%)")
    for axes in (above, below):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _near(row: Row) -> bool:
    return row.gap is not None and abs(row.gap) <= NEAR


def _plot_rows(axes: Axes, rows: Sequence[Row], column: str, scale: float) -> None:
    """Points for each title, in the colour of its kind; the policy for the front is a line."""
    used: list[str] = []
    for title in dict.fromkeys(row.title for row in rows):
        own = [row for row in rows if row.title == title]
        colour = "faint" if own[0].walking_share is None else colour_of_policy(title)
        axes.plot(
            np.array([row.speed for row in own], dtype=float),
            scale * np.array([getattr(row, column) for row in own], dtype=float),
            linestyle="-" if title == FRONT_POLICY else "none",
            linewidth=1.0,
            marker=MARKERS[used.count(colour) % len(MARKERS)],
            color=COLOURS[colour],
            label=title,
        )
        used.append(colour)


def colour_of_policy(title: str) -> str:
    """Laws, clones, fine-tuned policies and those from scratch have different colours."""
    kinds = {
        "orange": ("imitation", FRONT_POLICY),
        "blue": ("fine-tuned",),
        "ochre": ("PPO",),
        "violet": ("evolution",),
    }
    return next((c for c, starts in kinds.items() if title.startswith(starts)), "teal")


def learning_figure(curves: Mapping[str, Curve], front: CotFront) -> Figure:
    """The gap and the share of starts that walk, over control intervals and over minutes.

    A walk beyond the front's speeds is compared with the nearer end of the front.
    """
    figure, panels = plt.subplots(
        2, 2, figsize=(10.4, 6.4), sharex="col", sharey="row", layout="constrained"
    )
    for marker, (name, curve) in zip(itertools.cycle(MARKERS), curves.items(), strict=False):
        colour = COLOURS[colour_of_policy(name)]
        gaps = [milestone_gap(each, front) for each in curve]
        shares = [100.0 * float(each["walking_share"]) for each in curve]
        for row, values in zip(panels, (gaps, shares), strict=True):
            for axes, across in zip(row, ACROSS, strict=True):
                x = [each[across] for each in curve]
                axes.plot(x, values, f"{marker}-", markersize=4.0, color=colour, label=name)
    for axes, label in zip(panels[1], ACROSS.values(), strict=True):
        axes.set_xlabel(label)
    panels[0, 0].set_xscale("symlog", linthresh=1e5)
    panels[0, 0].set_yscale("symlog")
    panels[0, 0].yaxis.set_major_formatter("{x:g}")
    panels[0, 0].set_ylabel("gap to the optimum (%)")
    panels[1, 0].set(ylabel="starts that walk (%)", ylim=(-5.0, 105.0))
    named = panels[0, 0].get_legend_handles_labels()
    figure.legend(*named, loc="outside lower center", ncols=3)
    return figure


def milestone_gap(milestone: Mapping[str, Any], front: CotFront) -> float:
    """In per cent, at the front's speed nearest to that of the walk; NaN where none walks."""
    if not milestone["walking_share"]:
        return math.nan
    speeds = [gait.speed for gait in front.envelope]
    speed = min(max(milestone["speed"], speeds[0]), speeds[-1])
    return 100.0 * (float(milestone["cot"]) / float(front(speed)) - 1.0)
