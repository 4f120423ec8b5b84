from __future__ import annotations

import numpy as np
import pytest

from trajopt.feedback.orbit import Grid, located, mean_voltage, squared_distances


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
    t = np.linspace(0.05, held.duration - 0.05, 4000)
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
