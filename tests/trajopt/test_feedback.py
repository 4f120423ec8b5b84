from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.hybrid import DOUBLE
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.symbolic import HybridModel
from trajopt.feedback import LimitCycleLqr, law, laws
from trajopt.feedback.guard import Guarded

P = THESIS_PHYSICAL


@pytest.fixture(scope="module")
def lqr(one_step):
    return LimitCycleLqr.from_solution(one_step)


def walk(law, states, seconds):
    """Steps, energy (J) and distance (m) per state over its second half."""
    states, ticks = states.copy(), round(seconds / 0.01)
    totals = np.zeros((len(states), len(ROW)))
    for tick in range(ticks):
        out = advance(P, states, law(states[:, :4], states[:, 4].astype(int)))
        assert not out[:, ROW.failure].any()
        if tick >= ticks // 2:
            totals += out
    return totals


def test_it_holds_the_gait_at_a_hundred_hertz(lqr, one_step):
    states = np.zeros((8, STATE_SIZE))
    states[:, :4] = one_step.state(np.linspace(0.05, 0.85, 8))
    totals = walk(lqr, states, 30.0)
    distance, energy = totals[:, ROW.distance].sum(), totals[:, ROW.electrical_positive].sum()
    assert distance / (8 * 15.0) == pytest.approx(0.5, rel=0.03)
    assert energy / (P.weight * distance) < 1.25 * one_step.cot


def test_it_recovers_from_a_push(lqr, one_step):
    states = np.zeros((2, STATE_SIZE))
    states[:, :4] = one_step.state(0.4)
    states[:, 2] += [0.3, -0.3]
    assert walk(lqr, states, 10.0)[:, ROW.steps].min() >= 4


def test_it_starts_walking_from_rest(lqr):
    states = np.zeros((3, STATE_SIZE))
    states[:, 0], states[:, 1], states[:, 4] = P.constants.a, [-0.4, 0.0, 0.4], DOUBLE
    assert walk(lqr, states, 16.0)[:, ROW.steps].min() >= 7


def test_it_is_a_function_of_the_state_within_the_voltage_limit(lqr):
    rng = np.random.default_rng(0)
    x = rng.uniform([1.0, -3, -1, -5], [2.0, 3, 2, 5], (10, 4))
    together = lqr(x, np.zeros(10, int))
    alone = [lqr(state) for state in x]
    turned = lqr(x + [0, 2 * np.pi, 0, 0])
    assert np.array_equal(together, alone)
    assert np.allclose(together, turned)
    assert np.abs(together).max() <= P.voltage_limit


def test_on_the_gait_it_plays_the_gaits_voltage_between_the_points_of_its_table_too(lqr, one_step):
    t = np.linspace(0.03, one_step.duration - 0.03, 501)
    s, weights = np.polynomial.legendre.leggauss(16)
    hold = t[:, None] + 0.5 * lqr.lqr.period * (s + 1)
    wanted = 0.5 * one_step.control(hold.ravel()).reshape(hold.shape) @ weights
    error = lqr(one_step.state(t)) - wanted
    change = np.abs(np.diff(lqr.lqr.orbit.voltages)).max()  # from a point of the table to the next
    assert np.sqrt(np.mean(error**2)) < 0.03 * change


def test_it_is_the_lqr_near_the_gait_and_takes_the_lookaheads_voltages_far_from_it(lqr, one_step):
    rng = np.random.default_rng(1)
    near = one_step.state(rng.uniform(0.0, one_step.duration, 50))
    assert np.array_equal(lqr(near), lqr.lqr(near)[0])
    far = rng.uniform([P.constants.a, -3, -1, -5], [P.constants.b, 3, 2, 5], (200, 4))
    own, volts = lqr.lqr(far)[0], lqr(far)
    changed = volts != own
    assert changed.sum() > 20
    assert np.isin(volts[changed], lqr.lookahead.plan.candidates).all()


@pytest.mark.parametrize("name", laws())
def test_every_law_in_the_folder_holds_its_gait(name, one_step):
    controller = law(name)(one_step)
    states = np.zeros((4, STATE_SIZE))
    states[:, :4] = one_step.state(np.linspace(0.05, 0.85, 4))
    assert walk(controller, states, 10.0)[:, ROW.steps].min() >= 4


def test_a_law_that_nobody_wrote_is_refused_with_the_names_of_those_that_exist():
    assert "lqr" in laws()
    with pytest.raises(ValueError, match=r"name = 'lqg': must be one of .*lqr"):
        law("lqg")


@pytest.mark.parametrize("wanted", [-20.0, 0.0, 20.0])
def test_the_guard_changes_a_voltage_only_to_keep_the_foot_pressed_down(wanted):
    rng = np.random.default_rng(2)
    x = rng.uniform([P.constants.a, -3, -1, -8], [P.constants.b, 3, 2, 8], (400, 4))
    reaction = HybridModel(P).functions["ground_reaction"].map(len(x))

    def force(volts):
        return np.asarray(reaction(x.T, volts[None]))[1]

    volts = Guarded(P, lambda x, mode: np.full(len(x), wanted))(x, np.zeros(len(x), int))
    floor = 0.1 * P.weight
    asked, given = force(np.full(len(x), wanted)), force(volts)
    changed = volts != wanted
    assert np.abs(volts).max() <= P.voltage_limit
    assert np.array_equal(changed, (asked < floor) & (given > asked))
    within = changed & (np.abs(volts) < P.voltage_limit)
    assert given[within] == pytest.approx(floor)
    assert changed.sum() > 5


@pytest.mark.parametrize(
    ("x", "mode", "error", "message"),
    [
        (np.zeros(3), 0, ValueError, r"x: has shape \(3,\)"),
        (np.zeros((2, 4)), np.zeros(3, int), ValueError, r"mode: has shape \(3,\)"),
        (np.zeros((1, 4)), 2, ValueError, "mode = 2: must be 0 .*or 1"),
        ("resting", 0, TypeError, "x = 'resting'"),
    ],
)
def test_states_and_modes_that_do_not_fit_are_refused_by_name(lqr, x, mode, error, message):
    with pytest.raises(error, match=message):
        lqr(x, mode)
