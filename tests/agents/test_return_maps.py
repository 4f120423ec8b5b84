"""Return maps: the bare wheel down a slope has known ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.comparison.return_maps import (
    STEPS,
    Multiplier,
    ReturnMap,
    last_middle,
    multipliers_text,
    return_chart,
    return_map,
    touchdown_rates,
)
from agents.conditions import Conditions
from agents.rollout import Interval, Rollout
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats
from trajopt.gaits.problem import passive_wheel_rate

LEGS, SLOPE = 8, 0.12
#: Just before a touchdown (rad/s).
RATE = passive_wheel_rate(LEGS, SLOPE) / math.cos(2 * math.pi / LEGS)


@pytest.fixture(scope="module")
def bare() -> WheelParams:
    return WheelParams(
        n_legs=LEGS,
        slope=SLOPE,
        wheel_inertia=0.0,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )


def idle(states: Floats, observations: object) -> Floats:
    return np.zeros(len(states))


def walk(params: WheelParams, faster: float, seconds: float) -> list[Interval]:
    start = np.zeros((1, 6))
    start[0, [0, 2]] = params.constants.a + 1e-6, faster * passive_wheel_rate(LEGS, SLOPE)
    return list(Rollout(Conditions(params), idle, start, round(seconds / 0.01)))


def test_the_square_of_the_rate_comes_back_by_the_square_of_the_cosine(bare: WheelParams) -> None:
    start = walk(bare, 1.1, 0.01)[0].states
    [rates] = touchdown_rates(bare, idle, start, 5)
    share = math.cos(2 * math.pi / LEGS) ** 2
    before, after = rates[:-1] ** 2 - RATE**2, rates[1:] ** 2 - RATE**2
    np.testing.assert_allclose(after, share * before, rtol=1e-5)


def test_the_multipliers_are_those_of_the_cycle_and_of_what_nothing_brings_back(
    bare: WheelParams,
) -> None:
    found = return_map(bare, idle, walk(bare, 1.0, 5.0))
    assert found.steady == pytest.approx(RATE, rel=1e-6)
    assert found.multipliers is not None
    sizes = [each.size for each in found.multipliers]
    assert sizes[:3] == pytest.approx([1.0] * 3, abs=0.01)  # time, and the free pendulum's two
    assert sizes[3] == pytest.approx(math.cos(2 * math.pi / LEGS) ** 2, abs=0.01)
    assert {each.sign for each in found.multipliers} == {1}
    assert np.isfinite(found.rates).all()


def test_a_walk_without_steps_is_refused(bare: WheelParams) -> None:
    level = bare.replace(slope=0.0)
    with pytest.raises(ValueError, match="no step in the last 2 s"):
        return_map(level, idle, walk(level, 1.0, 12.0))


@pytest.mark.parametrize(("steps", "upright"), [(0, True), (-1, False)])
def test_a_leg_that_is_changed_out_of_double_stance_does_not_pass_the_vertical(
    bare: WheelParams, steps: int, upright: bool
) -> None:
    [interval] = walk(bare, 1.0, 0.01)
    after = interval.after.copy()
    after[0, 0] = bare.constants.b
    counts = {"touchdowns": np.zeros(1), "steps": np.full(1, steps)}
    found = last_middle([interval._replace(after=after, info=counts)])
    assert (found is not None) == upright


def test_a_chart_has_the_slopes_of_what_does_not_turn() -> None:
    rates = np.linspace(0.9, 1.1, 3 * STEPS).reshape(3, STEPS)
    found = ReturnMap(rates, 1.0, [Multiplier(0.5, 0), Multiplier(0.4, -1), Multiplier(0.1, 1)])
    chart = return_chart("clone", found, "orange", free=4.4)
    slopes = {
        each.name: (each.points[1][1] - each.points[1][0]) / (each.points[0][1] - each.points[0][0])
        for each in chart.series
        if each.line != "none"
    }
    assert slopes == {
        "the same again": pytest.approx(1.0),
        "slope of a multiplier": pytest.approx(-0.4),
        "slope 4.4, without feedback": pytest.approx(4.4),
    }
    assert chart.title == "clone: multipliers 0.50 (turning), -0.40"
    assert multipliers_text([Multiplier(1.0, 1)]) == "multipliers 1.00"


def test_walks_that_all_fall_at_once_have_no_spread_to_draw():
    fallen = np.full((2, 3), np.nan)
    assert ReturnMap(fallen, 5.0, None).spread == 0.0
    assert ReturnMap(np.full((2, 3), 5.0), math.nan, None).spread == 0.0
    assert ReturnMap(np.array([[4.9, 5.1]]), 5.0, None).spread > 0.0
