from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt.feedback.clock import Clock, has_clock, offset
from trajopt.feedback.laws import lqr, sliding_mode
from trajopt.feedback.orbit import Grid


@pytest.fixture(scope="module")
def other_hold(held):
    return dataclasses.replace(held, hold=2 * CONTROL_PERIOD)


@pytest.mark.parametrize("late", [-1e-3, 0.0, 1e-3])
def test_near_a_tick_a_wheel_on_the_gait_is_ahead_by_its_time_since_the_tick(held, late):
    clock, orbit = Clock.of(held, 0.03), Grid.of(held).orbit()
    for tick in held.first_tick + CONTROL_PERIOD * np.arange(5, 60, 5):
        assert offset(held.state(tick + late), orbit, clock).early == pytest.approx(
            late, rel=0.1, abs=2e-5
        )


def test_half_way_between_two_ticks_it_is_neither_early_nor_late(held):
    clock, orbit = Clock.of(held, 0.03), Grid.of(held).orbit()
    between = held.first_tick + CONTROL_PERIOD * (10.5 + np.linspace(-1e-3, 1e-3, 9))
    early = [offset(held.state(t), orbit, clock).early for t in between]
    assert np.abs(early[4]) < 1e-5
    assert np.abs(early).max() < 2e-3


def test_only_a_gait_that_is_held_for_a_control_period_has_a_clock(held, other_hold, gait):
    assert has_clock(held)
    assert Clock.of(held, 0.03) == (held.first_tick, 0.03)
    for solution in (other_hold, gait):
        assert not has_clock(solution)
        assert Clock.of(solution, 0.03).ahead == math.inf
    assert Clock.of(held, None).ahead == math.inf


def test_without_a_clock_a_law_has_no_gain_on_time(held, other_hold, gait):
    assert sliding_mode.design(held).data.timing_now.any()
    assert lqr.design(held).data.timing.any()
    for solution in (other_hold, gait):
        surface = sliding_mode.design(solution).data
        assert not surface.timing_now.any()
        assert not surface.timing_later.any()
        assert not lqr.design(solution).data.timing.any()
