"""How long a study will still take."""

from __future__ import annotations

import pytest

from scripts.studies.learning.cells import Result
from scripts.studies.learning.estimate import Estimate
from tests.scripts.studies.learning.toys import cells_of, toy


def test_the_time_that_is_left_follows_from_the_cells_that_are_finished() -> None:
    first, second, third = cells_of(toy(), 3)
    estimate = Estimate([first, second, third], {}, 2)
    assert estimate.minutes == pytest.approx(1.5 * toy().minutes, rel=0.01)
    estimate.finished(first, Result({}, 0, minutes=40.0))
    assert estimate.minutes == pytest.approx(40.0, rel=0.01)
    estimate.finished(second, None)
    estimate.finished(third, Result({}, 0, minutes=40.0))
    assert estimate.words == ""
