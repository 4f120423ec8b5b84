"""What a plot shows, whoever draws it: `plots` for a screen, `paper` for print."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.reports.colours import LIGHT

#: How an axis may be scaled; "symlog" is linear near 0 and logarithmic beyond its threshold.
SCALES = ("linear", "log", "symlog")

#: How points may be joined.
LINES = ("solid", "dashed", "none")


@dataclasses.dataclass(frozen=True)
class Axis:
    """An axis.

    Attributes:
        label: what it is, with its unit.
        scale: one of `SCALES`.
        threshold: up to which a symlog axis is linear.
        limits: least and greatest value shown; None: as the data are.
    """

    label: str
    scale: str = "linear"
    threshold: float = 1.0
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.scale not in SCALES:
            raise ValueError(f"scale = {self.scale!r}: must be one of {', '.join(SCALES)}")


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """Points that belong together.

    Attributes:
        name: what they are called; series of the same name share one entry of the legend.
        x, y: the points, N of each; NaN interrupts the line.
        colour: a name in `agents.reports.colours`.
        line: one of `LINES`.
        width: of the line (pixels).
        marks: whether each point is marked.
        hollow: indices of the points whose marks are not filled.
        named: whether the name is written beside the last point.
        notes: what else is told of each point when it is hovered, N of them or none.

    Raises:
        ValueError: there is no such colour or line, or the numbers of points differ.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    colour: str = "ink"
    line: str = "solid"
    width: float = 1.5
    marks: bool = False
    hollow: tuple[int, ...] = ()
    named: bool = False
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        if self.colour not in LIGHT:
            raise ValueError(f"colour = {self.colour!r}: must be one of {', '.join(LIGHT)}")
        if self.line not in LINES:
            raise ValueError(f"line = {self.line!r}: must be one of {', '.join(LINES)}")
        x, y = self.points
        if x.shape != y.shape or x.ndim != 1 or len(self.notes) not in (0, len(x)):
            raise ValueError(
                f"{self.name}: x of shape {x.shape}, y of shape {y.shape} and "
                f"{len(self.notes)} notes: give as many of each"
            )

    @property
    def points(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x and y as arrays."""
        return np.asarray(self.x, dtype=np.float64), np.asarray(self.y, dtype=np.float64)


@dataclasses.dataclass(frozen=True, eq=False)
class Chart:
    """A plot with one pair of axes.

    Attributes:
        title: above it.
        x, y: its axes.
        series: what it shows; later ones cover earlier ones.
    """

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series]
