from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym import energy as row
from rimless_gym.hybrid import DOUBLE
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from trajopt.feedback import LimitCycleLqr

P = THESIS_PHYSICAL


@pytest.fixture(scope="module")
def law(one_step):
    return LimitCycleLqr.from_solution(one_step)


def walk(law, states, seconds):
    """Steps, energy (J) and distance (m) per state over its second half."""
    states, ticks = states.copy(), round(seconds / 0.01)
    totals = np.zeros((len(states), row.N_ROWS))
    for tick in range(ticks):
        out = advance(P, states, law(states[:, :4], states[:, 4].astype(int)))
        assert not out[:, row.FAILURE].any()
        if tick >= ticks // 2:
            totals += out
    return totals


def test_it_holds_the_gait_at_a_hundred_hertz(law, one_step):
    states = np.zeros((8, STATE_SIZE))
    states[:, :4] = one_step.state(np.linspace(0.05, 0.85, 8))
    totals = walk(law, states, 30.0)
    distance, energy = totals[:, row.DISTANCE].sum(), totals[:, row.ELECTRICAL_POSITIVE].sum()
    assert distance / (8 * 15.0) == pytest.approx(0.5, rel=0.03)
    assert energy / (P.weight * distance) < 1.25 * one_step.cot


def test_it_recovers_from_a_push(law, one_step):
    states = np.zeros((2, STATE_SIZE))
    states[:, :4] = one_step.state(0.4)
    states[:, 2] += [0.3, -0.3]
    assert walk(law, states, 10.0)[:, row.STEPS].min() >= 4


def test_it_starts_walking_from_rest(law):
    states = np.zeros((3, STATE_SIZE))
    states[:, 0], states[:, 1], states[:, 4] = P.constants.a, [-0.4, 0.0, 0.4], DOUBLE
    assert walk(law, states, 16.0)[:, row.STEPS].min() >= 7


def test_it_is_a_function_of_the_state_within_the_voltage_limit(law):
    rng = np.random.default_rng(0)
    x = rng.uniform([1.0, -3, -1, -5], [2.0, 3, 2, 5], (10, 4))
    together = law(x, np.zeros(10, int))
    alone = [law(state) for state in x]
    turned = law(x + [0, 2 * np.pi, 0, 0])
    assert np.array_equal(together, alone)
    assert np.allclose(together, turned)
    assert np.abs(together).max() <= P.voltage_limit


def test_on_the_gait_it_plays_the_gaits_voltage_between_the_points_of_its_table_too(law, one_step):
    t = np.linspace(0.03, one_step.duration - 0.03, 501)
    s, weights = np.polynomial.legendre.leggauss(16)
    hold = t[:, None] + 0.5 * law.period * (s + 1)
    wanted = 0.5 * one_step.control(hold.ravel()).reshape(hold.shape) @ weights
    error = law(one_step.state(t)) - wanted
    change = np.abs(np.diff(law.voltages)).max()  # from a point of the table to the next
    assert np.sqrt(np.mean(error**2)) < 0.03 * change
