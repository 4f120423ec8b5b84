"""Names written beside the points of a figure, so that none covers another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from agents.comparison.style import FAINT

#: Size of the text, and distance between two lines of it (points).
SIZE, LINE = 8.0, 10.5

#: Points this near to each other in x share a column of names, which begins this far to their
#: right (points).
NEAR, ASIDE = 24.0, 12.0


class Named(NamedTuple):
    """A point and its name.

    Attributes:
        x, y: in the units of the axes.
        name: what is written.
        colour: of the text.
    """

    x: float
    y: float
    name: str
    colour: str


def write_names(axes: Axes, points: Sequence[Named]) -> None:
    """Write every name in a column to the right of its point, with a line from one to the other.

    The limits and the place of the axes must be final.
    """
    if not points:
        return
    scale = axes.figure.dpi / 72.0
    at = axes.transData.transform([(point.x, point.y) for point in points]) / scale
    bottom, top = axes.bbox.y0 / scale, axes.bbox.y1 / scale
    for column in _columns(at[:, 0].tolist()):
        column.sort(key=lambda i: (at[i, 1], -i))
        heights = spread([at[i, 1] for i in column], LINE, bottom + LINE / 2, top - LINE / 2)
        x = max(at[i, 0] for i in column) + ASIDE
        for i, y in zip(column, heights, strict=True):
            axes.annotate(
                points[i].name,
                (points[i].x, points[i].y),
                (x, y),
                textcoords="figure points",
                color=points[i].colour,
                fontsize=SIZE,
                va="center",
                path_effects=[withStroke(linewidth=2.5, foreground="white")],
                arrowprops={
                    "arrowstyle": "-",
                    "color": FAINT,
                    "linewidth": 0.6,
                    "shrinkA": 1.0,
                    "shrinkB": 3.0,
                },
            )


def _columns(xs: Sequence[float]) -> list[list[int]]:
    """Indices of the points that share a column, from left to right."""
    columns: list[list[int]] = []
    for i in np.argsort(xs, kind="stable").tolist():
        if columns and xs[i] - xs[columns[-1][-1]] < NEAR:
            columns[-1].append(i)
        else:
            columns.append([i])
    return columns


def spread(wanted: Sequence[float], least: float, low: float, high: float) -> list[float]:
    """Places as near as possible to those that are wanted, but apart from each other.

    Args:
        wanted: in ascending order.
        least: distance between neighbours.
        low: bound of the places.
        high: bound of the places; is exceeded where they do not fit.

    Returns:
        Places in the same order, with the least sum of squared distances to `wanted` where no bound
        is met.
    """
    groups: list[tuple[float, int]] = []  # mean of what is wanted less what is needed; members
    for i, place in enumerate(wanted):
        mean, count = place - i * least, 1
        while groups and groups[-1][0] > mean:
            before, members = groups.pop()
            mean, count = (before * members + mean * count) / (members + count), members + count
        groups.append((mean, count))
    last = high - (len(wanted) - 1) * least
    means = [max(low, min(mean, last)) for mean, count in groups for _ in range(count)]
    return [mean + i * least for i, mean in enumerate(means)]
