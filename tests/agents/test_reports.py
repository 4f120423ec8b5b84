"""A report is one valid file that loads nothing, and shows what it is given, whatever its name."""

from __future__ import annotations

import math
import re
from html import unescape
from pathlib import Path

import pytest

from agents.reports import (
    NONE,
    Axis,
    Chart,
    Column,
    Series,
    document,
    draw,
    embedded,
    paragraph,
    save,
    section,
    table,
)
from tests.agents.chromium import NEEDS_CHROMIUM, in_chromium
from tests.agents.html import assert_loads_nothing, assert_valid

NASTY = """</script><img onerror="alert('1')"> & <!--"""
COLUMNS = (Column("policy", "name"), Column("CoT", "cot", ".3f", "cost of transport"))
ROWS = [
    {"name": "law", "cot": 0.05},
    {"name": NASTY, "cot": None},
    {"name": "ppo", "cot": math.nan},
    {"name": "clone", "cot": 0.0514},
]
CHART = Chart(NASTY, Axis(NASTY), Axis("CoT", "log"), [Series(NASTY, [0.5, math.nan], [0.1, 0.2])])


def report() -> str:
    parts = [
        section("Table", table(COLUMNS, ROWS), paragraph(NASTY)),
        section("Plots", embedded([CHART])),
    ]
    return document(NASTY, NASTY, parts, 'page".html')


def test_a_report_is_valid_loads_nothing_and_escapes_every_text() -> None:
    text = report()
    assert_valid(text)
    assert_loads_nothing(text.replace(unescape(NASTY), ""))
    assert "<img onerror" not in text
    assert "<!--" not in text.removeprefix("<!doctype html>")
    assert text.count("&lt;img onerror=&quot;") >= 4
    assert text == report()


def test_the_checks_find_what_is_wrong() -> None:
    for wrong in ("<p><div></div></p>", "<b><i></b></i>", "<i>", "<ul><p></p></ul>"):
        with pytest.raises(AssertionError):
            assert_valid(f"<!doctype html>{wrong}")
    with pytest.raises(AssertionError):
        assert_loads_nothing("<script src='x.js'></script>")


def test_a_table_has_every_row_and_its_sort_keys() -> None:
    rows = re.findall(r"<tr>(<th scope=\"row\".*?)</tr>", table(COLUMNS, ROWS), flags=re.DOTALL)
    cells = [re.search(r'<td data-value="(.*?)">(.*?)</td>', row) for row in rows]
    assert [cell.groups() for cell in cells if cell] == [
        ("0.05", "0.050"),
        ("", NONE),
        ("", NONE),
        ("0.0514", "0.051"),
    ]
    assert 'title="cost of transport"' in table(COLUMNS, ROWS)


def test_charts_are_drawn_with_one_legend_or_one_each(tmp_path: Path) -> None:
    x = [0.0, 1.0]
    lines = [Series("law", x, x), Series("clone", x, x, "teal", "none", marker="o", hollow=(1,))]
    chart = Chart("CoT", Axis("speed", limits=(0, 2)), Axis("gap", "symlog"), lines)
    figure = draw([chart, chart, chart], across=2)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["law", "clone"]
    assert [axes.get_title() for axes in figure.axes] == ["CoT", "CoT", "CoT", ""]
    save(figure, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 5000
    alone = Chart("one", Axis("t"), Axis("y"), lines[:1])
    figure = draw([chart, alone], across=1, legends=True)
    legends = [axes.get_legend() for axes in figure.axes]
    assert [legend is not None for legend in legends] == [True, False]
    assert not figure.legends


@NEEDS_CHROMIUM[0]
@NEEDS_CHROMIUM[1]
def test_a_click_sorts_the_rows_and_another_one_reverses_them(tmp_path: Path) -> None:
    rows = [*ROWS[::2], {"name": "clone", "cot": 0.6}, {"name": "evolution", "cot": 1e-5}]
    found = in_chromium(
        document("A report", "", [section("Table", table(COLUMNS, rows))]),
        tmp_path,
        """
        const button = (i) => document.querySelectorAll('thead button')[i];
        const rows = () => [...document.querySelectorAll('tbody tr')];
        const names = () => rows().map((row) => row.cells[0].textContent);
        const orders = [names()];
        for (const i of [1, 1, 0]) { button(i).click(); orders.push(names()); }
        report({ orders, sorted: document.querySelectorAll('[aria-sort]').length });
        """,
    )
    assert found["orders"] == [
        ["law", "ppo", "clone", "evolution"],
        ["evolution", "law", "clone", "ppo"],  # what is missing stays last
        ["clone", "law", "evolution", "ppo"],
        ["clone", "evolution", "law", "ppo"],
    ]
    assert found["sorted"] == 1
