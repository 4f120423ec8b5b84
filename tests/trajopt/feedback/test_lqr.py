from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.equations import DOUBLE
from trajopt.feedback import laws
from trajopt.feedback.laws.lqr import design
from trajopt.feedback.orbit import squared_distances

P = THESIS_PHYSICAL


@pytest.fixture(scope="module")
def lqr(held):
    return design(held)


def test_it_holds_the_gait_for_the_cost_of_the_environments_own_optimum(lqr, held, walk):
    totals, _ = walk(lqr, held.state(np.linspace(0.05, 0.85, 8)), 30.0)
    distance, energy = totals[:, ROW.distance].sum(), totals[:, ROW.electrical_positive].sum()
    assert distance / (8 * 15.0) == pytest.approx(held.speed, rel=1e-3)
    assert energy / (P.weight * distance) == pytest.approx(held.cot, rel=5e-3)


def test_its_ticks_come_where_the_gaits_own_clock_has_them(lqr, held, walk):
    _, states = walk(lqr, held.state(np.linspace(0.05, 0.85, 8)), 20.0)
    ticks = held.state(held.first_tick + 0.01 * np.arange(round(held.duration / 0.01) - 1))
    off = states[:, None, :4] - ticks
    off[:, :, 1] -= 2 * np.pi * np.round(off[:, :, 1] / (2 * np.pi))
    assert np.linalg.norm(off / np.std(ticks, axis=0), axis=2).min(axis=1).max() < 5e-3


def test_without_the_clock_the_same_gait_costs_more(held, walk):
    starts = held.state(np.linspace(0.05, 0.85, 8))
    costs = []
    for ahead in (0.03, None):
        totals, _ = walk(design(held, ahead=ahead), starts, 20.0)
        costs.append(totals[:, ROW.electrical_positive].sum() / totals[:, ROW.distance].sum())
    assert costs[1] > 1.001 * costs[0]


def test_deviations_die_out(lqr, held, walk):
    starts = held.state(np.linspace(0.3, 0.6, 6)) + [0.0, 0.0, 0.05, -0.05]
    _, states = walk(lqr, starts, 6.0)
    before = squared_distances(starts, lqr.data.orbit)
    after = squared_distances(np.ascontiguousarray(states[:, :4]), lqr.data.orbit)
    assert (after < 0.01 * before).all()


@pytest.mark.parametrize("begin", [0.1, 0.4, 0.6, 0.8])
def test_its_voltage_has_no_jumps_beside_the_gait(lqr, held, begin):
    t = begin + np.linspace(0.0, 0.004, 1000)  # half a dozen of the table's nodes
    volts = lqr(held.state(t) + [0.002, 0.01, 0.01, 0.02])
    changes = np.abs(np.diff(volts))
    assert changes.max() < 20 * changes.mean()


def test_it_is_a_function_of_the_state_within_the_voltage_limit(lqr):
    rng = np.random.default_rng(0)
    x = rng.uniform([1.0, -3, -1, -5], [2.0, 3, 2, 5], (10, 4))
    together = lqr(x, np.zeros(10, int))
    assert np.array_equal(together, [lqr(state) for state in x])
    assert np.allclose(together, lqr(x + [0, 2 * np.pi, 0, 0]))
    assert np.abs(together).max() <= P.voltage_limit


def test_it_holds_a_gait_of_two_steps_with_a_continuous_voltage(gait, walk):
    totals, _ = walk(design(gait), gait.state(np.linspace(0.05, 1.7, 8)), 10.0)
    assert totals[:, ROW.steps].min() >= 4


@pytest.mark.parametrize("name", ["gentle", "firm", "blend", "ahead"])
def test_numbers_that_are_not_positive_are_refused_by_name(held, name):
    with pytest.raises(ValueError, match=f"{name} = -1.0: must be greater than 0"):
        design(held, **{name: -1.0})


def test_an_unknown_law_is_refused_with_the_names_of_the_known_ones(held):
    with pytest.raises(ValueError, match=r"law = 'lqg': choose from \[.*'lqr'"):
        laws.design("lqg", held)


def test_a_gait_that_failed_its_verification_is_refused(held):
    failed = dataclasses.replace(
        held, verification=dataclasses.replace(held.verification, failures=("it slips",))
    )
    with pytest.raises(ValueError, match=r"failed its verification \(it slips\)"):
        laws.holding("lqr", failed)
    with pytest.raises(TypeError, match="solution = 3"):
        laws.holding("lqr", 3)


@pytest.mark.parametrize(
    ("x", "mode", "error", "message"),
    [
        (np.zeros(3), 0, ValueError, r"x: has shape \(3,\)"),
        (np.zeros((2, 4)), np.zeros(3, int), ValueError, r"mode: has shape \(3,\)"),
        (np.zeros((1, 4)), 2, ValueError, "mode = 2: must be 0 .*or 1"),
        ("resting", 0, TypeError, "x = 'resting'"),
        ([[0.0, np.nan, 0.0, 0.0]], 0, ValueError, "x: has nan"),
        ([[0.0, 1e9, 0.0, 0.0]], 0, ValueError, "x: has 1000000000.0; .* at most 1e.06"),
    ],
)
def test_states_and_modes_that_do_not_fit_are_refused_by_name(lqr, x, mode, error, message):
    with pytest.raises(error, match=message):
        lqr(x, mode)


def test_double_stance_is_a_mode_that_a_law_takes(lqr, held):
    assert lqr(held.state(0.1), DOUBLE) == lqr(held.state(0.1))
