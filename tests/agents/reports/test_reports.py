"""A report is one valid file that loads nothing, and shows what it is given, whatever its name."""

from __future__ import annotations

import base64
import json
import math
import re
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.reports import (
    DARK,
    LIGHT,
    NONE,
    Axis,
    Chart,
    Column,
    Series,
    document,
    draw,
    figures,
    listed,
    paragraph,
    save,
    section,
    style_sheet,
    subsection,
    table,
)
from tests.agents.reports.checks import assert_loads_nothing, assert_valid

NASTY = """</script><img src=x onerror="alert('1')"> & <!--"""
COLUMNS = (Column("policy", "name"), Column("CoT", "cot", ".3f", "cost of transport"))
ROWS = [
    {"name": "law", "cot": 0.05},
    {"name": NASTY, "cot": None},
    {"name": "ppo", "cot": math.nan},
    {"name": "clone", "cot": 0.0514},
]
CHART = Chart(
    NASTY,
    Axis(NASTY),
    Axis("CoT", "log"),
    [Series(NASTY, [0.5, math.nan, 0.6], [0.1, 0.2, 0.3], marks=True, notes=[NASTY] * 3)],
)


@pytest.fixture(scope="module")
def text() -> str:
    parts = [
        section("Table", table(COLUMNS, ROWS, [f"row-{i}" for i in range(4)]), paragraph(NASTY)),
        *(subsection(NASTY, listed([NASTY]), anchor=f"row-{i}") for i in range(4)),
        section("Plots", plots([CHART, CHART])),
    ]
    return document(NASTY, NASTY, parts, 'page".html')


def data_of(html: str) -> list[dict[str, Any]]:
    found = re.findall(r'<script type="application/json">(.*?)</script>', html, flags=re.DOTALL)
    return [json.loads(each) for each in found]


def test_a_report_is_valid_and_loads_nothing(text: str) -> None:
    assert_valid(text)
    assert_loads_nothing(text.replace(unescape(NASTY), "").replace("src=x", ""))


def test_whatever_is_printed_is_escaped(text: str) -> None:
    assert "<img" not in text
    assert "<!--" not in text.removeprefix("<!doctype html>")
    assert text.count("&lt;img src=x onerror=&quot;") > 8
    assert data_of(text)[0]["series"][0]["name"] == NASTY


def test_the_checks_find_what_is_wrong() -> None:
    for wrong in ("<p><div></div></p>", "<b><i></b></i>", "<i>", "<ul><p></p></ul>"):
        with pytest.raises(AssertionError):
            assert_valid(f"<!doctype html>{wrong}")
    with pytest.raises(AssertionError):
        assert_loads_nothing("<script src='x.js'></script>")


def test_a_table_has_every_row_and_says_what_it_is_sorted_by() -> None:
    rows = re.findall(r"<tr>(<th scope=\"row\".*?)</tr>", table(COLUMNS, ROWS), flags=re.DOTALL)
    assert len(rows) == len(ROWS)
    cells = [re.search(r'<td data-value="(.*?)">(.*?)</td>', row) for row in rows]
    assert [cell.groups() for cell in cells if cell] == [
        ("0.05", "0.050"),
        ("", NONE),
        ("", NONE),
        ("0.0514", "0.051"),
    ]
    assert 'title="cost of transport"' in table(COLUMNS, ROWS)


def test_a_plot_has_every_point() -> None:
    [data] = data_of(plots([CHART]))
    [series] = data["series"]
    numbers = np.frombuffer(base64.b64decode(series["x"]), dtype="<f4")
    np.testing.assert_allclose(numbers, [0.5, math.nan, 0.6], rtol=1e-6)
    assert data["y"]["scale"] == "log"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"colour": "pink"}, "colour = 'pink'.*teal"),
        ({"line": "dotted"}, "line = 'dotted'.*dashed"),
        ({"y": [1.0]}, "as many of each"),
        ({"notes": ["one"]}, "as many of each"),
    ],
)
def test_points_that_cannot_be_drawn_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Series(**({"name": "law", "x": [1.0, 2.0], "y": [1.0, 2.0]} | changes))


def test_an_unknown_scale_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"scale = 'square'.*symlog"):
        Axis("CoT", "square")


def test_every_colour_has_one_for_dark_screens() -> None:
    assert list(DARK) == list(LIGHT)
    assert all(style_sheet().count(f"--series-{name}:") == 2 for name in LIGHT)


def test_charts_are_printed_with_one_legend(tmp_path: Path) -> None:
    x = [0.0, 1.0]
    chart = Chart("CoT", Axis("speed", limits=(0, 2)), Axis("gap", "symlog"), [
        Series("law", x, x), Series("clone", x, x, "teal", "none", marks=True, hollow=(1,)),
    ])  # fmt: skip
    figure = printed([chart, chart, chart], across=2)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["law", "clone"]
    assert [axes.get_title() for axes in figure.axes] == ["CoT", "CoT", "CoT", ""]
    save(figure, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 5000


def test_charts_may_have_legends_of_their_own_where_there_is_more_than_one_line() -> None:
    x = [0.0, 1.0]
    one, other = Series("angle", x, x), Series("rate", x, x, "teal")
    charts = [Chart(title, Axis("t"), Axis("y"), lines) for title, lines in
              (("both", [one, other]), ("one", [one]))]  # fmt: skip
    figure = printed(charts, across=1, own_legends=True)
    both, alone = (axes.get_legend() for axes in figure.axes)
    assert both is not None
    assert alone is None
    assert not figure.legends
    assert [text.get_text() for text in both.get_texts()] == ["angle", "rate"]
