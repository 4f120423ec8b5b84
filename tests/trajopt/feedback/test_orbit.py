"""A gait as a table, the phase of a state on it, and the clock of a held gait."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt.feedback.laws import lqr, sliding_mode
from trajopt.feedback.orbit import (
    Clock,
    Grid,
    has_clock,
    located,
    mean_voltage,
    offset,
    squared_distances,
)


@pytest.fixture(scope="module")
def grid(held):
    return Grid.of(held)


@pytest.fixture(scope="module")
def orbit(grid):
    return grid.orbit()


def test_the_gait_itself_lies_on_its_orbit(held, orbit):
    states = held.state(np.linspace(0.0, 0.999 * held.duration, 400))
    assert np.sqrt(squared_distances(states, orbit).max()) < 2e-4


def test_the_phase_of_a_state_on_the_gait_is_its_time(held, orbit):
    for t in np.linspace(0.01, held.duration - 0.01, 50):
        spot = located(held.state(t), orbit)
        times = orbit.times[[spot.node, spot.node + 1]]
        assert times[0] + spot.share * (times[1] - times[0]) == pytest.approx(t, abs=2e-5)


def test_the_phase_moves_without_jumps_along_a_path_beside_the_gait(held, orbit):
    t = np.linspace(0.3, 0.5, 900)
    beside = held.state(t) + 0.05 * np.std(orbit.states, axis=0) * [1, -1, 1, -1]
    spots = [located(x, orbit) for x in beside]
    phase = np.array([spot.node + spot.share for spot in spots])
    assert np.abs(np.diff(phase)).max() < 1.0  # nodes; the path itself moves by 0.3


def test_whole_turns_of_the_pendulum_do_not_change_the_distance(held, orbit):
    states = held.state(np.linspace(0.1, 0.8, 9)) + [0.1, 0.2, 0.3, 0.4]
    turned = states + [0.0, 4 * np.pi, 0.0, 0.0]
    assert squared_distances(turned, orbit) == pytest.approx(squared_distances(states, orbit))


def test_the_mean_voltage_of_a_held_gait_from_a_tick_on_is_the_voltage_that_it_holds(held):
    ticks = held.first_tick + 0.01 * np.arange(round(held.duration / 0.01) - 1)
    assert mean_voltage(held, ticks, 0.01) == pytest.approx(held.held_voltages[:-1], abs=1e-9)


def test_times_of_the_grid_keep_away_from_touchdowns(gait):
    grid = Grid.of(gait)
    gaps = np.abs(grid.times[:, None] - np.asarray(gait.phase_times))
    assert gaps.min() > 0.05 * (grid.times[1] - grid.times[0])


@pytest.fixture(scope="module")
def other_hold(held):
    return dataclasses.replace(held, hold=2 * CONTROL_PERIOD)


@pytest.mark.parametrize("late", [-1e-3, 0.0, 1e-3])
def test_near_a_tick_a_wheel_on_the_gait_is_ahead_by_its_time_since_the_tick(held, orbit, late):
    clock = Clock.of(held, 0.03)
    for tick in held.first_tick + CONTROL_PERIOD * np.arange(5, 60, 5):
        assert offset(held.state(tick + late), orbit, clock).early == pytest.approx(
            late, rel=0.1, abs=2e-5
        )


def test_half_way_between_two_ticks_it_is_neither_early_nor_late(held, orbit):
    clock = Clock.of(held, 0.03)
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


def test_without_a_clock_a_law_has_no_gain_on_time(law, held, other_hold):
    assert law.data.timing.any()
    assert not lqr.design(other_hold).data.timing.any()
    surfaces = (sliding_mode.design(solution).data for solution in (held, other_hold))
    assert [each.timing_now.any() for each in surfaces] == [True, False]
