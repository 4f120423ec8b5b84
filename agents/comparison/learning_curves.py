"""Learning curves: the gap to the optimum and the share of starts, over steps and over minutes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from agents.comparison.labels import SIZE, Named, write_names
from agents.comparison.style import COLOURS, STYLE
from trajopt.gaits.fronts import CotFront

#: Below so many per cent and control intervals, the axes are linear, so that 0 can be shown.
LINEAR_GAP, LINEAR_INTERVALS = 1.0, 1e5

#: What is drawn over, by its name in a milestone, and how its axis is called.
ACROSS = {
    "intervals": "control intervals of training",
    "minutes": "minutes of one core, evaluations and the cloning before included",
}

#: Milestones of a training (`agents.training.Milestone`) as plain values, in order.
Curve: TypeAlias = Sequence[Mapping[str, Any]]


def plot_learning_curves(path: Path, curves: Mapping[str, Curve], front: CotFront) -> None:
    """Draw the milestones of trainings.

    A walk beyond the front's speeds is compared with the nearer end of the front, and is hollow.

    Args:
        path: of the picture.
        curves: by the names that are written beside them.
        front: that gaps are measured against.
    """
    with matplotlib.rc_context(STYLE):
        figure, plots = plt.subplots(2, 2, figsize=(11, 6.6), sharex="col", sharey="row")
        figure.subplots_adjust(0.085, 0.085, 0.985, 0.98, wspace=0.05, hspace=0.08)
        _scale(plots, curves)
        figures = (lambda milestone: gap(milestone, front)), share
        for column, across in zip(plots.T, ACROSS, strict=True):
            for axes, of in zip(column, figures, strict=True):
                ends = _plot(axes, across, of, curves, front)
                if axes is not plots[1, 1]:  # where lines are many, and named above and beside
                    write_names(axes, ends)
            column[1].set_xlabel(ACROSS[across])
        figure.savefig(path, dpi=150)
        plt.close(figure)


def gap(milestone: Mapping[str, Any], front: CotFront) -> float:
    """In per cent, at the front's speed nearest to that of the walk; NaN where none walks."""
    if not milestone["walking_share"]:
        return math.nan
    speeds = [gait.speed for gait in front.envelope]
    speed = min(max(milestone["speed"], speeds[0]), speeds[-1])
    return 100.0 * (float(milestone["cot"]) / float(front(speed)) - 1.0)


def share(milestone: Mapping[str, Any]) -> float:
    """Share of the starts that walk, in percent."""
    return 100.0 * float(milestone["walking_share"])


def _scale(plots: Any, curves: Mapping[str, Curve]) -> None:
    """The limits, with room for names at the right."""
    last = [curve[-1] for curve in curves.values() if curve]
    steps, minutes = (max([1.0, *(each[across] for each in last)]) for across in ACROSS)
    plots[0, 0].set_xscale("symlog", linthresh=LINEAR_INTERVALS, linscale=0.4)
    plots[0, 0].set_xlim(-0.1 * LINEAR_INTERVALS, 60.0 * max(steps, LINEAR_INTERVALS))
    plots[0, 1].set_xlim(-0.02 * minutes, 1.5 * minutes)
    plots[0, 0].set_yscale("symlog", linthresh=LINEAR_GAP, linscale=0.6)
    ticks = (0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
    plots[0, 0].set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    plots[0, 0].set_ylim(-0.5, 3000.0)
    plots[0, 0].minorticks_off()
    plots[0, 0].set_ylabel("gap to the optimum (%)")
    plots[0, 1].text(
        *(0.99, 0.98, "hollow: slower or faster than the front"),
        transform=plots[0, 1].transAxes,
        fontsize=SIZE,
        ha="right",
        va="top",
    )
    plots[1, 0].set_ylim(-5.0, 105.0)
    plots[1, 0].set_ylabel("starts that walk (%)")


def _plot(
    axes: Axes,
    across: str,
    of: Callable[[Mapping[str, Any]], float],
    curves: Mapping[str, Curve],
    front: CotFront,
) -> list[Named]:
    """A line for each training; their names and ends."""
    ends = []
    for (name, curve), colour in zip(curves.items(), COLOURS[1:], strict=False):
        points = [(float(each[across]), of(each)) for each in curve]
        axes.plot(*zip(*points, strict=True), color=colour, linewidth=1.2)
        for point, each in zip(points, curve, strict=True):
            axes.plot(*point, "o", color=colour, markersize=4, mfc=_face(each, front, colour))
        drawn = [point for point in points if math.isfinite(point[1])]
        ends += [Named(*drawn[-1], name, colour)] if drawn else []
    return ends


def _face(milestone: Mapping[str, Any], front: CotFront, colour: str) -> str:
    """Filled if it walks at one of the front's speeds, or not at all."""
    return "white" if beyond(milestone, front) else colour


def beyond(milestone: Mapping[str, Any], front: CotFront) -> bool:
    """Whether it walks slower or faster than the front."""
    ends = front.envelope[0].speed, front.envelope[-1].speed
    return bool(milestone["walking_share"] and not ends[0] <= milestone["speed"] <= ends[1])
