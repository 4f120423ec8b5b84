"""The LQR with tuned numbers: what is scored, and what evolution makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from rimless_gym.kernel.stepping import DTHETA
from trajopt.feedback.laws import lqr, tuned
from trajopt.feedback.orbit import offset, squared_distances

SHORT = {"wheels": 48, "generations": 3}


@pytest.fixture(scope="module")
def linear(one_step):
    return lqr.design(one_step)


@pytest.fixture(scope="module")
def tuned_law(one_step):
    return tuned.design(one_step, **SHORT)


@pytest.fixture(scope="module")
def trial(one_step, linear):
    return tuned.Trial.about(one_step, linear.data.orbit, SHORT["wheels"], 0)


def test_zeros_leave_the_lqr_as_it_is_and_other_numbers_do_not(linear, one_step):
    zeros = np.zeros(tuned.COUNT)
    same, changed = (
        tuned.with_numbers(linear.data, one_step.duration, q) for q in (zeros, zeros + 0.1)
    )
    for name in ("voltages", "gentle", "firm", "timing", "blend"):
        assert np.array_equal(getattr(same, name), getattr(linear.data, name))
    for name in ("voltages", "gentle", "firm", "blend"):
        assert not np.array_equal(getattr(changed, name), getattr(linear.data, name))


def test_a_trial_starts_on_the_gait_at_ticks_and_beside_it(held, law):
    orbit = law.data.orbit
    trial = tuned.Trial.about(held, orbit, 16, 0)
    early = [offset(x, orbit, law.data.clock).early for x in trial.gait.T]
    assert early == pytest.approx([0.0, 0.0], abs=2e-5)
    away = np.sqrt(squared_distances(np.ascontiguousarray(trial.disturbed[:4].T), orbit))
    assert len(away) == 16
    assert 0.0 < away.min() < away.max() < 1.5 * max(tuned.SIZES)


def test_a_law_that_loses_wheels_costs_more_or_walks_backwards_scores_worse(
    linear, trial, one_step, monkeypatch
):
    count = trial.gait.shape[1]

    def score(distance=1.0, energy=1.0, off=0.0, lasted=1.0):
        columns = (np.full(count, each) for each in (lasted, energy, distance, off))
        walks = tuned.TrialWalks(*columns)
        monkeypatch.setattr(tuned, "walked", lambda *args: walks)
        return tuned.score(linear, one_step, trial)

    assert score(distance=-1.0) == score(distance=0.0) == tuned.COST_WEIGHT
    assert score(off=np.inf, lasted=0.5) > score(off=np.inf) > tuned.COST_WEIGHT
    assert score() < score(energy=2.0)
    assert score() < score(off=0.05)


@pytest.mark.slow
def test_evolution_scores_better_than_the_lqr_and_the_same_for_the_same_seed(
    tuned_law, linear, trial, one_step
):
    assert tuned.score(tuned_law, one_step, trial) < tuned.score(linear, one_step, trial)
    np.random.seed(5)  # noqa: NPY002
    wanted = np.random.random()  # noqa: NPY002
    np.random.seed(5)  # noqa: NPY002
    again = tuned.design(one_step, **SHORT)
    assert np.random.random() == wanted  # noqa: NPY002
    assert np.array_equal(again.data.firm, tuned_law.data.firm)
    other = tuned.design(one_step, **SHORT, seed=1)
    assert not np.array_equal(other.data.firm, tuned_law.data.firm)


@pytest.mark.slow
def test_a_wheel_that_falls_is_counted_as_lost_and_the_others_as_if_alone(linear, trial):
    states = trial.disturbed.copy()
    states[DTHETA, :3] += 20.0
    together = tuned.walked(linear, states, 1.0)
    alone = tuned.walked(linear, states[:, 7:8], 1.0)
    assert together.energy[7] == alone.energy[0]
    assert together.off[7] == alone.off[0]
    assert together.lasted[:3].max() < 0.99
    assert np.isinf(together.off[:3]).all()
    assert together.lasted[7] == pytest.approx(1.0)
    assert np.isfinite(together.off[7])
