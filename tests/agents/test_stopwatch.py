"""The time that work in a folder takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.stopwatch import FILE, forget, minutes, timed


def test_the_time_of_a_training_counts_on_through_stops(tmp_path: Path) -> None:
    def work() -> float:
        with timed(tmp_path) as so_far:
            sum(range(2_000_000))
            told = so_far()
        assert 0.0 < told <= minutes(tmp_path)
        return minutes(tmp_path)

    first = work()
    assert 0.0 < first < work()
    forget(tmp_path)
    assert minutes(tmp_path) == 0.0


@pytest.mark.parametrize("text", ["", "NaN", "-1.0", '"2"'])
def test_a_damaged_count_of_minutes_is_named_with_the_remedy(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(ValueError, match=r"minutes\.json: damaged .* remove this file: only the"):
        minutes(tmp_path)
