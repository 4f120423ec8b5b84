"""The least of several costs, some of which differ only by rounding."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.ocp.guesses import line
from trajopt.ocp.multi_start import Outcome, distinct
from trajopt.ocp.ranking import clearly_less, least_first, tied


def test_items_that_clearly_differ_are_in_order_of_cost() -> None:
    assert least_first([3.0, -1.0, 2.0], float) == [-1.0, 2.0, 3.0]


@pytest.mark.parametrize("hair", [-1e-9, 0.0, 1e-9])
def test_of_items_that_tie_the_first_comes_first(hair: float) -> None:
    costs = {"far": 2.0, "first": 1.0, "second": 1.0 + hair, "cheap": 0.5, "third": 1.0 - hair}
    assert least_first(costs, costs.__getitem__) == ["cheap", "first", "second", "third", "far"]
    assert tied(1.0, 1.0 + hair)
    assert not clearly_less(1.0, 1.0 + abs(hair))


def test_infinite_costs_come_last() -> None:
    assert least_first([np.inf, 1.0, np.inf], float) == [1.0, np.inf, np.inf]
    assert least_first([], float) == []


@pytest.mark.parametrize("hair", [-1e-10, 0.0, 1e-10])
def test_of_starts_that_led_to_one_optimum_the_first_stands_for_it(hair: float) -> None:
    way = line(np.zeros(1), np.ones(1), np.zeros(1), 1.0)
    mirrored = line(np.zeros(1), -np.ones(1), np.zeros(1), 1.0)
    ends = {4: (way, 1.0), 2: (mirrored, 1.0 + hair), 7: (way, 1.0 - hair), 5: (way, 0.5)}
    outcomes = [Outcome(i, "", cost, (end,), np.empty(0), 1, "") for i, (end, cost) in ends.items()]
    found = [(optimum.best.index, optimum.starts) for optimum in distinct(outcomes)]
    assert found == [(5, (5,)), (2, (2,)), (4, (4, 7))]
