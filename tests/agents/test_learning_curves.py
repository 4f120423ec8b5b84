"""What learning curves are drawn from, and where it is kept."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agents.comparison.learned import Learned, learning_curve
from agents.comparison.learning_curves import gap, plot_learning_curves
from rimless_gym import BUILDABLE
from tests.agents.runs import run
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.library import shipped


@pytest.fixture
def front() -> CotFront:
    own = [gait for gait in shipped() if gait.params == BUILDABLE and gait.steps == 1]
    return CotFront(tuple(gait for gait in own if 0.5 <= gait.speed <= 0.6))


def milestone(**changes: float) -> dict[str, float]:
    usual = {"intervals": 0, "minutes": 0.0, "walking_share": 1.0, "speed": 0.55, "cot": 0.06}
    return usual | changes


def test_a_training_that_went_on_keeps_the_curve_of_one_in_one_go(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", timesteps=256).curve
    run(tmp_path / "parts", timesteps=128)
    first = run(tmp_path / "parts", timesteps=128).curve
    parts = run(tmp_path / "parts", timesteps=256).curve
    assert repr(parts[: len(first)]) == repr(first)  # nan is unequal
    minutes = [each.minutes for each in parts]
    assert minutes[0] > 0.0
    assert minutes == sorted(minutes)
    assert parts[-1].intervals == whole[-1].intervals == 256 * 4  # held for 4 control intervals
    assert len({each.intervals for each in parts}) > 2


def test_the_minutes_of_a_cloning_count_for_what_begins_from_it() -> None:
    results = {
        "imitation": {"curve": [milestone(minutes=1.5)]},
        "fine_tuned": {"curve": [milestone(minutes=0.0), milestone(minutes=0.5)]},
    }
    tuned = Learned("fine_tuned", "imitation/clone.zip", {}, 1.0, after=("imitation",))
    assert [each["minutes"] for each in learning_curve(tuned, results)] == [1.5, 2.0]


def test_the_gap_of_a_milestone_is_that_at_the_nearest_speed_of_the_front(front: CotFront) -> None:
    last = front.envelope[-1]
    assert gap(milestone(speed=last.speed, cot=1.1 * last.cot), front) == pytest.approx(10.0)
    assert gap(milestone(speed=0.9, cot=2 * last.cot), front) == pytest.approx(100.0)
    assert math.isnan(gap(milestone(walking_share=0.0, cot=math.nan, speed=math.nan), front))


def test_curves_of_any_kind_are_drawn(tmp_path: Path, front: CotFront) -> None:
    nothing = [milestone(walking_share=0.0, cot=math.nan, speed=math.nan)]
    curves = {"walks": [milestone(), milestone(intervals=9, minutes=2.0)], "stands": nothing}
    plot_learning_curves(tmp_path / "curves.png", curves, front)
    assert (tmp_path / "curves.png").stat().st_size > 10_000
