"""Names written beside the points of a figure, so that none covers another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from agents.comparison.style import FAINT
from trajopt.feedback.law import Floats

#: Size of the text, and distance between two lines of it (points).
SIZE, LINE = 8.0, 10.5

#: Points this near to each other in x share a column of names, which begins this far to their
#: right (points).
NEAR, ASIDE = 24.0, 12.0

#: The mean width of a letter over the size of the text, at the most.
LETTER = 0.62


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
    low, high = axes.bbox.y0 / scale + LINE / 2, axes.bbox.y1 / scale - LINE / 2
    for column in _columns(at, [point.name for point in points], low, high):
        for i, y in zip(column.points, column.heights, strict=True):
            axes.annotate(
                points[i].name,
                (points[i].x, points[i].y),
                (column.left, y),
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


class Column(NamedTuple):
    """Names below each other.

    Attributes:
        points: indices of the points that are named, from below.
        left: where the names begin (points).
        right: where the longest one ends (points).
        heights: of the names (points).
    """

    points: list[int]
    left: float
    right: float
    heights: list[float]

    def covers(self, other: Column, at: Floats) -> bool:
        """Whether its names cover those of a column further right, or its points."""
        if self.right <= min(at[i, 0] for i in other.points):
            return False
        taken = [*other.heights, *(at[i, 1] for i in other.points)]
        return any(abs(y - height) < LINE for y in self.heights for height in taken)


def _columns(at: Floats, names: Sequence[str], low: float, high: float) -> list[Column]:
    """Columns of names from left to right, none of which covers the next one.

    Args:
        at: where the points are (points), (N, 2).
        names: of the points.
        low: least height of a name (points).
        high: greatest height of a name (points).
    """

    def column(of: Sequence[int]) -> Column:
        indices = sorted(of, key=lambda i: (at[i, 1], -i))
        left = max(at[i, 0] for i in indices) + ASIDE
        longest = max(len(names[i]) for i in indices)
        heights = spread([at[i, 1] for i in indices], LINE, low, high)
        return Column(indices, left, left + longest * LETTER * SIZE, heights)

    found: list[Column] = []
    for i in np.argsort(at[:, 0], kind="stable").tolist():
        if found and at[i, 0] - max(at[k, 0] for k in found[-1].points) < NEAR:
            found[-1] = column([*found[-1].points, i])
        else:
            found.append(column([i]))
    for k in reversed(range(len(found) - 1)):
        while k + 1 < len(found) and found[k].covers(found[k + 1], at):
            found[k : k + 2] = [column([*found[k].points, *found[k + 1].points])]
    return found


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
