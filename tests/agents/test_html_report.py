"""The comparison's HTML report shows every row and every plot, whatever has been compared."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.comparison import html_report
from agents.comparison.arena import Arena
from agents.comparison.charts import learning_charts, speed_charts
from agents.comparison.study import Study
from agents.reports.charts import Axis, Chart, Series
from rimless_gym import BUILDABLE
from tests.agents.reports.checks import assert_loads_nothing, assert_valid
from trajopt.gaits.fronts import CotFront, NoFrontError
from trajopt.gaits.library import shipped

ROW = {
    "cot": 0.05,
    "return": 0.2,
    "speed": 0.55,
    "gap": 0.01,
    "walking_share": 1.0,
    "friction_demand": 0.7,
    "min_normal_force_over_weight": 0.2,
}
ROWS: list[dict[str, Any]] = [
    ROW | {"policy": "optimal", "walking_share": None},
    ROW | {"policy": "LQR about the optimum"},
    ROW | {"policy": "fine-tuned <b>", "cot": 0.051},
    ROW | {"policy": "PPO from scratch", "cot": 0.6, "gap": 11.0},
    ROW | {"policy": "stands", "cot": None, "gap": None, "speed": math.nan, "walking_share": 0.0},
]
MILESTONE = {"intervals": 0, "minutes": 0.5, "walking_share": 1.0, "speed": 0.55, "cot": 0.06}
CURVES = {"PPO": [MILESTONE], "stands": [MILESTONE | {"walking_share": 0.0, "cot": None}]}


@pytest.fixture
def front() -> CotFront:
    own = [gait for gait in shipped() if gait.params == BUILDABLE and gait.steps == 1]
    return CotFront(tuple(gait for gait in own if 0.5 <= gait.speed <= 0.6))


@pytest.fixture
def arena(tmp_path: Path, front: CotFront) -> Arena:
    arena = Arena(Study(), tmp_path, progress=False)
    arena.front = arena.held_front = front
    return arena


def written(arena: Arena) -> str:
    walks = Chart("a walk", Axis("x"), Axis("y"), [Series("law", [0.0], [0.0])])
    html_report.write_report(arena, ROWS, ([walks], [walks]), CURVES)
    return (arena.out / "report.html").read_text()


def test_the_report_has_every_row_and_links_to_the_page(
    arena: Arena, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html_report, "write_page", lambda path, policy: path)
    text = written(arena)
    assert_valid(text)
    assert_loads_nothing(text)
    assert text.count('<th scope="row"') == len(ROWS)
    assert "fine-tuned &lt;b&gt;" in text
    assert 'href="page.html"' in text
    assert text.count('<figure class="card chart">') == 2 + 1 + 1 + 4


def test_a_machine_without_a_page_has_a_report(
    arena: Arena, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(path: Path, policy: Path) -> Path:
        raise NoFrontError("no gaits of this machine are shipped")

    monkeypatch.setattr(html_report, "write_page", none)
    text = written(arena)
    assert_valid(text)
    assert "page.html" not in text


def test_every_policy_that_walks_stands_on_the_front(front: CotFront) -> None:
    costs, gaps = speed_charts(front, front, ROWS)
    names = {each.name: each.named for each in costs.series}
    assert names["PPO from scratch"]
    assert not names["LQR"]  # near to the front: its name stands in the other plot
    assert {each.name for each in gaps.series if each.named} == {"LQR", "fine-tuned <b>"}
    assert "stands" not in names


def test_milestones_that_do_not_walk_have_a_share_and_no_gap(front: CotFront) -> None:
    gap, _, share, _ = learning_charts(CURVES, front)
    assert np.isnan(gap.series[1].points[1]).all()
    assert share.series[1].points[1].tolist() == [0.0]
