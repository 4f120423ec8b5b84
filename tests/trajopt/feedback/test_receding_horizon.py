from __future__ import annotations

import pickle

import numpy as np
import pytest
from numba import njit

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from trajopt.feedback.laws import lqr, receding_horizon

#: numba compiles the law for some ten seconds.
pytestmark = pytest.mark.slow

P = THESIS_PHYSICAL


@pytest.fixture(scope="module")
def law(one_step):
    return receding_horizon.design(one_step)


@pytest.fixture(scope="module")
def linear(one_step):
    return lqr.design(one_step)


def disturbed(gait, law, size, count):
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(count, 4))
    ways *= size / np.linalg.norm(ways, axis=1, keepdims=True)
    times = rng.uniform(0.1, 0.9, count) * gait.duration
    return np.asarray(gait.state(times)) + ways / np.sqrt(law.data.orbit.metric)


def lasting(law, x, seconds):
    states = np.zeros((len(x), STATE_SIZE))
    states[:, :4] = x
    walks = np.ones(len(x), dtype=bool)
    for _ in range(round(100 * seconds)):
        volts = law(states[:, :4], states[:, 4].astype(int))
        walks &= advance(P, states, volts)[:, ROW.failure] == 0.0
    return walks.sum()


def test_on_the_gait_it_plays_nearly_the_gaits_own_voltage(law, linear, one_step):
    x = np.asarray(one_step.state(np.linspace(0.05, 0.95, 40) * one_step.duration))
    assert np.sqrt(np.mean((law(x) - linear(x)) ** 2)) < 0.1 * P.voltage_limit


def test_it_is_a_function_of_the_state_within_the_voltage_limit(law, linear, one_step):
    x = disturbed(one_step, law, 0.5, 20)
    together = law(x)
    assert np.array_equal(together, [law(state) for state in x])
    assert np.allclose(together, law(x + [0, 2 * np.pi, 0, 0]), atol=1e-3)
    assert np.abs(together).max() <= P.voltage_limit


@njit
def iterated(x, data):
    start = receding_horizon.started(x, SINGLE, data)
    return start, receding_horizon.improved(start, 0, data)


def test_an_iteration_keeps_all_its_shifts_within_the_voltage_limit(law, one_step):
    short = law.data._replace(horizon=4)
    for x in disturbed(one_step, law, 1.0, 3):
        for motion in iterated(x, short):
            voltages = motion.nominal[:-1] + motion.shifts
            assert np.abs(voltages).max() <= P.voltage_limit * (1 + 1e-12)


def test_it_holds_more_disturbed_wheels_than_the_lqr(law, linear, one_step):
    x = disturbed(one_step, law, 0.6, 24)
    assert lasting(law, x, 1.0) > lasting(linear, x, 1.0)


def test_it_does_not_leave_the_process_in_which_its_kernel_is(law):
    with pytest.raises(TypeError, match="design it where it acts"):
        pickle.dumps(law.data)
