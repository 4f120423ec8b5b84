"""Plots for a screen: drawn by the page itself, as wide as there is room."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from html import escape
from typing import Any

from agents.page.packing import packed
from agents.reports.charts import Chart, Series


def plots(charts: Sequence[Chart]) -> str:
    """Charts side by side, as HTML."""
    return f'<div class="plots">{"".join(map(_figure, charts))}</div>'


def _figure(chart: Chart) -> str:
    data = {
        "x": dataclasses.asdict(chart.x),
        "y": dataclasses.asdict(chart.y),
        "series": [_series(each) for each in chart.series],
    }
    title = escape(chart.title)
    return (
        f'<figure class="card chart"><figcaption>{title}</figcaption>'
        f'<div class="plot" role="img" tabindex="0" aria-label="{title}"></div>'
        f'<script type="application/json">{embedded(data)}</script></figure>\n'
    )


def _series(series: Series) -> dict[str, Any]:
    x, y = series.points
    return {
        "name": series.name,
        "x": packed(x),
        "y": packed(y),
        "colour": series.colour,
        "line": series.line,
        "width": series.width,
        "marks": series.marks,
        "hollow": series.hollow,
        "named": series.named,
        "notes": list(series.notes),
    }


def embedded(data: Any) -> str:
    """JSON that can stand in a script element of a page, whatever its texts are."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
