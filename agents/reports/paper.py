"""The same charts for print."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.reports.charts import Axis, Chart, Series
from agents.reports.colours import LIGHT

DASHES = {"solid": "-", "dashed": "--", "none": "none"}

#: Width and height of one chart (inches).
SIZE = (3.4, 2.8)


#: Width of a name in the legend (inches).
NAME = 2.2


def printed(
    charts: Sequence[Chart],
    across: int,
    size: tuple[float, float] = SIZE,
    own_legends: bool = False,
) -> Figure:
    """Charts in rows of so many.

    Args:
        charts: to draw.
        across: how many stand beside each other.
        size: of each (inches).
        own_legends: whether each chart has a legend of its own beside it, not one below for all.
    """
    down = max(1, -(-len(charts) // across))
    whole = size[0] * across, size[1] * down
    figure, panels = plt.subplots(down, across, figsize=whole, layout="constrained", squeeze=False)
    named: dict[str, Any] = {}
    for axes, chart in zip(panels.flat, charts, strict=False):
        for series in chart.series:
            drawn = _draw(axes, series)
            named.setdefault(series.name, drawn)
        axes.set_title(chart.title, fontsize=9)
        _scale(axes, chart.x, "x")
        _scale(axes, chart.y, "y")
        if own_legends and len(chart.series) > 1:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    for axes in panels.flat[len(charts) :]:
        axes.set_axis_off()
    if len(named) > 1 and not own_legends:
        figure.legend(
            list(named.values()),
            list(named),
            loc="outside lower center",
            ncols=round(whole[0] / NAME),
            frameon=False,
        )
    return figure


def _draw(axes: Axes, series: Series) -> Any:
    x, y = series.points
    (line,) = axes.plot(
        *(x, y),
        linestyle=DASHES[series.line],
        color=LIGHT[series.colour],
        linewidth=series.width,
        label=series.name,
        marker="o" if series.marks else None,
        markersize=5.0 if len(x) < 30 else 2.0,
    )
    if series.hollow:
        at = list(series.hollow)
        axes.plot(x[at], y[at], "o", mfc="white", color=LIGHT[series.colour], markersize=3.5)
    return line


def _scale(axes: Axes, axis: Axis, name: str) -> None:
    axes.set(**{f"{name}label": axis.label})
    settings = {"linthresh": axis.threshold} if axis.scale == "symlog" else {}
    getattr(axes, f"set_{name}scale")(axis.scale, **settings)
    if axis.limits:
        getattr(axes, f"set_{name}lim")(np.asarray(axis.limits))


def save(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure to a file and let go of it."""
    figure.savefig(path, dpi=dpi)
    plt.close(figure)
