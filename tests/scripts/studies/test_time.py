"""How long a study has taken, and how long it will take."""

from __future__ import annotations

from pathlib import Path

import pytest

from scripts.studies.cells import Result
from scripts.studies.estimate import Estimate
from scripts.studies.stopwatch import forget, minutes, timed
from tests.scripts.studies.toys import cells_of, toy


def test_the_time_of_a_training_counts_on_through_stops(tmp_path: Path) -> None:
    def work() -> float:
        with timed(tmp_path):
            sum(range(2_000_000))
        return minutes(tmp_path)

    first = work()
    assert 0.0 < first < work()
    forget(tmp_path)
    assert minutes(tmp_path) == 0.0
    (tmp_path / "minutes.json").write_text("{")
    with pytest.raises(ValueError, match=r"damaged.*to train anew"):
        work()


def test_the_time_that_is_left_follows_from_the_cells_that_are_finished() -> None:
    first, second, third = cells_of(toy(), 3)
    estimate = Estimate([first, second, third], {}, 2)
    assert estimate.minutes == pytest.approx(1.5 * toy().minutes, rel=0.01)
    estimate.finished(first, Result({}, 0, minutes=40.0))
    assert estimate.minutes == pytest.approx(40.0, rel=0.01)
    estimate.finished(second, None)
    estimate.finished(third, Result({}, 0, minutes=40.0))
    assert estimate.words == ""
