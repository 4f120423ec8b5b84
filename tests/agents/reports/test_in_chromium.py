"""A report in a headless Chromium: tables sort, plots tell their values, phones have room."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.reports import Axis, Chart, Column, Series, document, figures, section, table
from tests.agents.chromium import NEEDS_CHROMIUM, in_chromium

pytestmark = NEEDS_CHROMIUM

COLUMNS = (
    Column("policy", "name"),
    Column("CoT", "cot", ".4f"),
    *(Column(f"another figure {i}", "cot", ".4f") for i in range(8)),
)
ROWS = [
    {"name": "law", "cot": 0.05},
    {"name": "ppo", "cot": None},
    {"name": "clone", "cot": 0.6},
    {"name": "evolution", "cot": 1e-5},
]
SPEEDS = np.linspace(0.5, 0.6, 11)
CHART = Chart(
    "Cost of transport",
    Axis("speed (m/s)"),
    Axis("CoT", "log"),
    [
        Series("front", SPEEDS, 0.1 - SPEEDS / 10),
        Series("clone", [0.55], [0.6], "teal", "none", marks=True, named=True, notes=["seed 0"]),
    ],
)
REPORT = document("A report", "", [section("Table", table(COLUMNS, ROWS)), plots([CHART] * 3)])


def test_a_click_sorts_the_rows_and_another_one_turns_them_round(tmp_path: Path) -> None:
    found = in_chromium(
        REPORT,
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


@pytest.mark.parametrize("size", ["390,844", "1280,800"])
def test_a_plot_tells_the_values_of_the_point_under_the_pointer(tmp_path: Path, size: str) -> None:
    found = in_chromium(
        REPORT,
        tmp_path,
        """
        const plot = document.querySelector('.plot');
        const box = plot.getBoundingClientRect();
        const tip = () => plot.querySelector('.tip')?.innerText ?? '';
        const over = (x, y) => {
          const at = { clientX: box.left + x, clientY: box.top + y };
          plot.dispatchEvent(new PointerEvent('pointermove', at));
          return tip();
        };
        const mark = plot.querySelector('circle');
        const told = over(Number(mark.getAttribute('cx')) + 5, Number(mark.getAttribute('cy')) + 5);
        const width = plot.querySelector('.tip').getBoundingClientRect();
        const inside = width.left >= box.left - 1 && width.right <= box.right + 1;
        const away = over(-100, -100);
        plot.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight' }));
        const keyed = tip();
        const names = [...plot.querySelectorAll('.name')].map((name) => name.textContent);
        const wide = document.documentElement.scrollWidth - innerWidth;
        report({ told, away, keyed, names, inside, wide });
        """,
        size,
    )
    assert found["told"].split("\n") == ["clone", "speed (m/s): 0.55", "CoT: 0.6", "seed 0"]
    assert found["away"] == ""
    assert found["keyed"].startswith("front\nspeed (m/s): 0.5")
    assert found["names"] == ["clone"]
    assert found["inside"]
    assert found["wide"] <= 0  # the table scrolls by itself


def test_an_axis_has_ticks_at_round_values(tmp_path: Path) -> None:
    found = in_chromium(
        REPORT,
        tmp_path,
        """
        const usual = { threshold: 1, limits: null };
        const ticks = (axis, values) => scaled({ ...usual, ...axis }, values, 0, 500, 6).ticks;
        report({
          linear: ticks({ scale: 'linear' }, [0, 1]),
          log: ticks({ scale: 'log' }, [0.03, 2]),
          symlog: ticks({ scale: 'symlog' }, [-0.5, 1000]).sort((a, b) => a - b),
          one: ticks({ scale: 'linear' }, [3]).length,
          none: ticks({ scale: 'log' }, [NaN]).length,
        });
        """,
    )
    assert found["linear"] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert found["log"] == pytest.approx([0.05, 0.1, 0.2, 0.5, 1, 2])
    assert found["symlog"][0] == 0
    assert found["symlog"][-1] == 1000
    assert found["one"] > 0
    assert isinstance(found["none"], int)
