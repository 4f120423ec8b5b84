"""In which intervals the touchdowns fall."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.gaits.held_stride import Pattern


def test_the_touchdowns_fall_into_the_intervals_around_them():
    pattern = Pattern.around(0.1, np.array([0.0, 0.53, 1.2]), lead=0.04)
    # Ticks at 0.04, 0.14, ..., 1.14: between 0 and 0.53 are five, then seven.
    assert pattern.whole == (4, 6)
    assert pattern.ticks == 12
    shares = np.array([0.9, 0.6])  # of the intervals from 0.44 and, before the start, from -0.06
    np.testing.assert_allclose(np.diff(pattern.edges_of(0, shares))[[0, 1, -1]], [0.04, 0.1, 0.09])
    assert pattern.edges_of(0, shares)[-1] == pytest.approx(0.53)
    assert pattern.edges_of(1, shares)[-1] == pytest.approx(0.67)


def test_an_interval_that_a_touchdown_splits_has_one_voltage_on_both_sides():
    pattern = Pattern(0.1, (4, 6))
    first, second = pattern.voltages_of(0), pattern.voltages_of(1)
    assert first[-1] == second[0]
    assert second[-1] == first[0]
    assert set(first) | set(second) == set(range(12))


def test_a_touchdown_can_be_moved_to_a_neighbouring_interval_if_there_is_one():
    assert Pattern(0.1, (4, 6)).moved(0, 1) == Pattern(0.1, (5, 5))
    assert Pattern(0.1, (0, 6)).moved(0, -1) is None
    assert Pattern(0.1, (4,)).moved(0, 1) == Pattern(0.1, (4,))
