"""Reports: one HTML file with figures of matplotlib and tables that can be sorted.

A report loads nothing, and every text in it is escaped.
"""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

import matplotlib
from matplotlib.figure import Figure

from trajopt.store import provenance

#: Colours of lines and markers, by name.
COLOURS = {
    "ink": "#26303b",
    "faint": "#8a97a6",
    "teal": "#0b8f83",
    "orange": "#e5562e",
    "blue": "#3b6fb6",
    "ochre": "#b0892b",
    "violet": "#8459a8",
}

#: Settings of matplotlib with which figures are drawn.
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

#: In place of a value that is missing.
NONE = "-"


def embedded(figure: Figure, title: str) -> str:
    """A figure as HTML that loads nothing."""
    picture = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(picture, format="svg", metadata={"Date": None})
    data = base64.b64encode(picture.getvalue()).decode()
    image = f'<img alt="{escape(title)}" src="data:image/svg+xml;base64,{data}">'
    return f'<figure class="card chart">{image}</figure>\n'


class Column(NamedTuple):
    """A column of a table."""

    heading: str  # above it
    key: str  # of its value in a row. It sorts the rows
    form: str = ""  # the format of a number, as in ".4f"; "" for a text
    meaning: str = ""  # a sentence that explains it

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

    The first column names a row.
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

    `parts` are HTML, `lead` the sentences under the title. `page` is the path of the page of
    `rimless page` relative to the report; None: there is none.
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
