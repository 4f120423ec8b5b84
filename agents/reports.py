"""Reports: one HTML file with tables that can be sorted, and charts.

Matplotlib draws the charts (`draw`), as files or embedded in a report. A report loads nothing, and
every text in it is escaped.
"""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter
from numpy.typing import ArrayLike

from trajopt.provenance import provenance

#: Colours of lines and marks, by name.
COLOURS = {
    "ink": "#26303b",
    "faint": "#8a97a6",
    "teal": "#0b8f83",
    "orange": "#e5562e",
    "blue": "#3b6fb6",
    "ochre": "#b0892b",
    "violet": "#8459a8",
}

STYLE: Any = {  # matplotlib types its keys one by one
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": COLOURS["faint"],
    "axes.labelcolor": COLOURS["ink"],
    "axes.titlesize": 9,
    "text.color": COLOURS["ink"],
    "xtick.color": COLOURS["ink"],
    "ytick.color": COLOURS["ink"],
    "axes.grid": True,
    "grid.color": "#e6eaef",
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "rimless-gym",
}

#: Width and height of a chart (inches), and the width of a name in a legend.
SIZE, NAME = (3.4, 2.8), 2.2

#: In place of a value that is missing.
NONE = "-"


@dataclasses.dataclass(frozen=True)
class Axis:
    """An axis.

    Attributes:
        label: what it is, with its unit.
        scale: of matplotlib: "linear", "log", or "symlog", which is linear near 0.
        threshold: up to which a symlog axis is linear.
        limits: least and greatest value shown; None: as the data are.
    """

    label: str
    scale: str = "linear"
    threshold: float = 1.0
    limits: tuple[float, float] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """Points that belong together.

    Attributes:
        name: in the legend; series of the same name share one entry.
        x, y: the points, N of each; NaN interrupts the line.
        colour: a name in `COLOURS`.
        line: of matplotlib: "-", "--" or "none".
        width: of the line (points).
        marker: of each point, as matplotlib names them; "" for none.
        hollow: indices of the points whose markers are not filled.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    colour: str = "ink"
    line: str = "-"
    width: float = 1.5
    marker: str = ""
    hollow: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Chart:
    """A plot with one pair of axes; later series cover earlier ones."""

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series]


def draw(
    charts: Sequence[Chart],
    across: int,
    size: tuple[float, float] = SIZE,
    legends: bool = False,
) -> Figure:
    """Charts in rows of so many.

    Args:
        charts: to draw.
        across: how many stand beside each other.
        size: of each (inches).
        legends: whether each chart has a legend beside it, not one below for all.
    """
    down = max(1, -(-len(charts) // across))
    whole = size[0] * across, size[1] * down
    with matplotlib.rc_context(STYLE):
        figure, panels = plt.subplots(
            down, across, figsize=whole, layout="constrained", squeeze=False
        )
        named: dict[str, Any] = {}
        for axes, chart in zip(panels.flat, charts, strict=False):
            for series in chart.series:
                line = _draw_series(axes, series)
                named.setdefault(series.name, line)
            axes.set_title(chart.title)
            _scale(axes, chart.x, "x")
            _scale(axes, chart.y, "y")
            if legends and len(chart.series) > 1:
                axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        for axes in panels.flat[len(charts) :]:
            axes.set_axis_off()
        if len(named) > 1 and not legends:
            columns = max(1, round(whole[0] / NAME))
            figure.legend(
                list(named.values()), list(named), loc="outside lower center", ncols=columns
            )
    return figure


def _draw_series(axes: Axes, series: Series) -> Any:
    x, y = (np.asarray(each, dtype=np.float64) for each in (series.x, series.y))
    (line,) = axes.plot(
        *(x, y),
        linestyle=series.line,
        color=COLOURS[series.colour],
        linewidth=series.width,
        label=series.name,
        marker=series.marker,
        markersize=5.0 if len(x) < 30 else 2.0,
    )
    if series.hollow:
        shown = list(series.hollow)
        axes.plot(
            *(x[shown], y[shown]),
            linestyle="none",
            marker=series.marker,
            mfc="white",
            color=COLOURS[series.colour],
            markersize=4.0,
        )
    return line


def _scale(axes: Axes, axis: Axis, name: str) -> None:
    axes.set(**{f"{name}label": axis.label})
    settings = {"linthresh": axis.threshold} if axis.scale == "symlog" else {}
    getattr(axes, f"set_{name}scale")(axis.scale, **settings)
    if axis.scale != "linear":  # plain numbers, not powers
        getattr(axes, f"{name}axis").set_major_formatter("{x:g}")
    if axis.scale == "log":
        formatter = LogFormatter(minor_thresholds=(2.0, 0.5))
        getattr(axes, f"{name}axis").set_minor_formatter(formatter)
    if axis.limits:
        getattr(axes, f"set_{name}lim")(np.asarray(axis.limits))


def embedded(figure: Figure, title: str) -> str:
    """A figure as HTML that loads nothing."""
    picture = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(picture, format="svg", metadata={"Date": None})
    data = base64.b64encode(picture.getvalue()).decode()
    image = f'<img alt="{escape(title)}" src="data:image/svg+xml;base64,{data}">'
    return f'<figure class="card chart">{image}</figure>\n'


class Column(NamedTuple):
    """A column of a table.

    Attributes:
        heading: above it.
        key: of its value in a row. It sorts the rows.
        form: the format of a number, as in ".4f"; "" for a text.
        meaning: a sentence that explains it.
    """

    heading: str
    key: str
    form: str = ""
    meaning: str = ""

    def text(self, row: Mapping[str, Any]) -> str:
        """The row's value in this column as text."""
        return value_text(row[self.key], self.form)


def value_text(value: Any, form: str) -> str:
    """A value as text; what is missing, or not finite, is a dash."""
    return NONE if _missing(value) else format(value, form)


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def table(columns: Sequence[Column], rows: Sequence[Mapping[str, Any]]) -> str:
    """A table as HTML; a value that is None, NaN or infinite is a dash, and is sorted to the end.

    Args:
        columns: the first one names a row.
        rows: one mapping per row.
    """
    head = "".join(map(_heading, columns))
    body = "\n".join(_row(columns, row) for row in rows)
    return (
        '<div class="scrolling" tabindex="0"><table class="sortable">'
        f"<thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>"
    )


def _heading(column: Column) -> str:
    title = f' title="{escape(column.meaning)}"' if column.meaning else ""
    text = escape(column.heading)
    return f'<th scope="col"{title}><button type="button">{text}</button></th>'


def _row(columns: Sequence[Column], row: Mapping[str, Any]) -> str:
    first, *others = columns
    name = escape(first.text(row))
    cells = "".join(
        f'<td data-value="{_sort_key(row[each.key])}">{escape(each.text(row))}</td>'
        for each in others
    )
    return f'<tr><th scope="row" data-value="{_sort_key(row[first.key])}">{name}</th>{cells}</tr>'


def _sort_key(value: Any) -> str:
    """The value by which a row is sorted; empty where it is missing."""
    if _missing(value):
        return ""
    return escape(str(float(value) if isinstance(value, bool | int | float) else value))


def section(title: str, *parts: str) -> str:
    """A part of a report with a heading."""
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(parts) + "</section>"


def paragraph(text: str) -> str:
    """Sentences."""
    return f"<p>{escape(text)}</p>"


def document(title: str, lead: str, parts: Sequence[str], page: str | None = None) -> str:
    """A report as one HTML file that loads nothing.

    Args:
        title: its heading.
        lead: the sentences under it.
        parts: HTML, as the functions of this module return it.
        page: path of the page of `rimless page`, relative to the report; None: there is none.
    """
    static = files("agents") / "static"
    style = "\n".join(
        (static / name).read_text(encoding="utf-8") for name in ("page/base.css", "report.css")
    )
    program = (static / "tables.js").read_text(encoding="utf-8")
    link = ""
    if page is not None:
        words = "See it walk, and drive it yourself"
        link = f'<p><a class="button" href="{escape(page)}">{words}</a></p>\n'
    body, made = "\n".join(parts), escape(json.dumps(provenance()))
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>
{style}
</style>
</head>
<body>
<main>
<header>
<p class="kicker">rimless-gym</p>
<h1>{escape(title)}</h1>
<p class="lead">{escape(lead)}</p>
{link}</header>
{body}
<footer><p>Made with {made}</p></footer>
</main>
<script>
{program}
</script>
</body>
</html>
"""
