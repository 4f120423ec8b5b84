"""A report is one valid file that loads nothing, and shows what it is given, whatever its name."""

from __future__ import annotations

import math
import re

import matplotlib.pyplot as plt

from agents.reports import (
    Column,
    document,
    embedded,
    paragraph,
    section,
    table,
)

NASTY = """</script><img onerror="alert('1')"> & <!--"""
COLUMNS = (Column("policy", "name"), Column("CoT", "cot", ".3f", "cost of transport"))
ROWS = [
    {"name": "law", "cot": 0.05},
    {"name": NASTY, "cot": None},
    {"name": "ppo", "cot": math.nan},
    {"name": "clone", "cot": 0.0514},
]


def assert_loads_nothing(text: str) -> None:
    """Check that no address of another file stands where a browser would load it."""
    text = re.sub(r'src="data:[^"]*"', "", text)
    assert not re.search(r"https?:|@import|<link[^>]+href=\"(?!data:)|\bsrc=|fetch\(|url\(", text)


def report() -> str:
    figure, axes = plt.subplots()
    axes.set_title(NASTY)
    parts = [
        section("Table", table(COLUMNS, ROWS), paragraph(NASTY)),
        section("Plots", embedded(figure, NASTY)),
    ]
    plt.close(figure)
    return document(NASTY, NASTY, parts, 'page".html')


def test_a_report_is_valid_loads_nothing_and_escapes_every_text() -> None:
    text = report()
    assert_loads_nothing(text)
    assert "<img onerror" not in text
    assert "<!--" not in text.removeprefix("<!doctype html>")
    assert text.count("&lt;img onerror=&quot;") >= 4
    assert text == report()
