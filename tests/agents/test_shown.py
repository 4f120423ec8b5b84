"""Which walks are drawn: those that last, and still take steps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from agents.comparison.figures import DRAWN, cycle_charts, is_steady, return_charts, walk_from_rest
from agents.reports import draw
from agents.rollout import Interval
from rimless_gym import BUILDABLE


def test_a_wheel_that_stands_is_not_steady() -> None:
    walk = list(walk_from_rest(BUILDABLE, lambda states, seen: np.zeros(len(states)), DRAWN))
    assert not is_steady(walk)


def rolling(intervals: int, steps: int) -> Iterator[Interval]:
    """A made-up walk whose leg passes the vertical in every tenth interval."""
    for k in range(intervals):
        before, after = np.zeros((2, 1, 6))
        before[0, 0] = 1.5
        after[0, 0] = 1.6 if k % 10 == 5 else 1.55
        info = {"steps": np.array([steps * (k % 10 == 0)]), "touchdowns": np.array([k % 10 == 0])}
        running, seen = np.zeros(1, dtype=np.int64), np.zeros((1, 6), dtype=np.float32)
        yield Interval(running, before, seen, np.zeros(1), info, after)


def test_a_walk_must_last_and_take_steps() -> None:
    whole = round(DRAWN / 0.01)
    assert is_steady(list(rolling(whole, 1)))
    assert not is_steady(list(rolling(whole - 1, 1)))
    assert not is_steady(list(rolling(whole, 0)))


def test_nothing_is_drawn_where_nothing_walks() -> None:
    assert cycle_charts([]) == return_charts(BUILDABLE, []) == []
    assert [axes.get_title() for axes in printed([], across=4).axes] == [""] * 4
