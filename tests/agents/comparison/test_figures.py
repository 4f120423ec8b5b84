"""The plots and the report of a comparison have every row, and any kind of result."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from agents.comparison import figures
from agents.comparison.figures import (
    learning_figure,
    milestone_gap,
    speed_figure,
    write_figures,
)
from agents.comparison.study import Setting, Study
from agents.comparison.table import FRONT_POLICY, Row
from rimless_gym import BUILDABLE
from trajopt.gaits.fronts import CotFront, NoFrontError
from trajopt.gaits.library import shipped

ROWS = [
    Row("LQR about the optimum", 0.56, 0.05, 0.2, 0.55, 0.01, 1.0, 0.6, 0.2),
    Row("fine-tuned <b>", 0.56, 0.05, 0.2, 0.55, 0.02, 0.9, 0.6, 0.2),
    Row("optimal while the pendulum swings", 0.56, 0.6, -0.1, 0.55, 11.0, None, 0.6, 0.2),
    Row("stands", None, walking_share=0.0),
    *(Row(FRONT_POLICY, v, 0.05, 0.2, v, 0.01, 1.0) for v in (0.52, 0.55, 0.58)),
]


@pytest.fixture(scope="module")
def front() -> CotFront:
    gaits = [gait for gait in shipped() if gait.params == BUILDABLE and gait.steps == 1]
    return CotFront(tuple(gait for gait in gaits if 0.5 <= gait.speed <= 0.6))


def milestone(**changes: float) -> dict[str, float]:
    usual = {"intervals": 0, "minutes": 0.0, "walking_share": 1.0, "speed": 0.55, "cot": 0.06}
    return usual | changes


STANDING = milestone(walking_share=0.0, cot=math.nan, speed=math.nan)


def lines(axes: Axes) -> dict[str, Line2D]:
    """The lines of some axes, by name."""
    return {str(line.get_label()): line for line in axes.lines}


def test_all_that_walk_are_plotted_and_those_near_the_optimum_with_their_gaps(
    front: CotFront,
) -> None:
    figure = speed_figure(front, front, ROWS)
    costs, gaps = map(lines, figure.axes)
    optima = {"optimal, voltage held", "optimal, voltage continuous"}
    assert set(costs) == optima | {row.title for row in ROWS} - {"stands"}
    assert set(gaps) == optima | {FRONT_POLICY, "LQR about the optimum", "fine-tuned <b>"}
    np.testing.assert_allclose(gaps["optimal, voltage held"].get_ydata(), 0.0)
    joined = gaps[FRONT_POLICY]
    assert (list(joined.get_xdata()), joined.get_linestyle()) == ([0.52, 0.55, 0.58], "-")
    np.testing.assert_allclose(joined.get_ydata(), 1.0)
    markers = [(line.get_color(), line.get_marker()) for line in costs.values()]
    assert len(set(markers)) == len(markers) - 1  # but for the two fronts
    plt.close(figure)


def test_the_gap_of_a_milestone_is_that_at_the_nearest_speed_of_the_front(front: CotFront) -> None:
    last = front.envelope[-1]
    near = milestone(speed=last.speed, cot=1.1 * last.cot)
    assert milestone_gap(near, front) == pytest.approx(10.0)
    assert milestone_gap(milestone(speed=0.9, cot=2 * last.cot), front) == pytest.approx(100.0)
    curves = {
        "PPO": [near],
        **{f"PPO {seed}": [near] for seed in range(9)},
        "evolution": [STANDING],
    }
    figure = learning_figure(curves, front)
    assert all(lines(axes).keys() == curves.keys() for axes in figure.axes)
    gap, _, share, _ = (lines(axes)["evolution"] for axes in figure.axes)
    assert np.isnan(gap.get_ydata()).all()
    assert list(share.get_ydata()) == [0.0]
    plt.close(figure)


def test_the_report_has_every_row_also_where_nothing_walks(
    front: CotFront, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_page(*arguments: object) -> None:
        raise NoFrontError("none")

    monkeypatch.setattr(figures, "page", no_page)
    setting = Setting(Study(), tmp_path)
    setting.front = setting.held_front = front
    curves = {"PPO": [STANDING, milestone(intervals=9, minutes=2.0)], "evolution": [STANDING]}
    write_figures(setting, ROWS, curves)
    text = (tmp_path / "report.html").read_text()
    assert "fine-tuned &lt;b&gt;" in text
    assert text.count("<tr>") == len(ROWS) + 1
    for picture in ("cot_against_speed", "learning_curves"):
        assert (tmp_path / f"{picture}.png").stat().st_size > 1000
