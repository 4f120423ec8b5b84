from __future__ import annotations

import numpy as np
import pytest

from rimless_gym.kernel.stepping import DTHETA
from trajopt.feedback import tuning
from trajopt.feedback.laws import lqr, tuned

SHORT = {"wheels": 48, "generations": 3, "progress": False}


@pytest.fixture(scope="module")
def law(one_step):
    return tuned.design(one_step, **SHORT)


@pytest.fixture(scope="module")
def trial(one_step, law):
    return tuning.Trial.about(one_step, law.data.orbit, SHORT["wheels"], 0)


@pytest.mark.slow
def test_without_a_generation_it_is_the_lqr(one_step):
    x = np.asarray(one_step.state(np.linspace(0.0, one_step.duration, 50))) + 0.05
    untuned = tuned.design(one_step, **SHORT | {"generations": 0})
    assert np.array_equal(untuned(x), lqr.design(one_step)(x))


def test_evolution_scores_better_than_the_lqr(law, trial, one_step):
    linear = lqr.design(one_step)
    assert tuning.score(law, one_step, trial) < tuning.score(linear, one_step, trial)


def test_the_same_seed_gives_the_same_law_and_leaves_numpys_generator_alone(law, one_step):
    np.random.seed(5)  # noqa: NPY002
    wanted = np.random.random()  # noqa: NPY002
    np.random.seed(5)  # noqa: NPY002
    again = tuned.design(one_step, **SHORT)
    assert np.random.random() == wanted  # noqa: NPY002
    assert np.array_equal(again.data.firm, law.data.firm)
    other = tuned.design(one_step, **SHORT, seed=1)
    assert not np.array_equal(other.data.firm, law.data.firm)


def test_its_voltage_has_no_jumps_about_the_gait(law, one_step):
    x = np.asarray(one_step.state(np.linspace(0.1, 0.9, 20001) * one_step.duration))
    x = x + 0.03 / np.sqrt(law.data.orbit.metric)
    x = x[law(x) ** 2 < law.params.voltage_limit**2]
    steps = np.abs(np.diff(law(x)))
    assert steps.max() < 0.05 * law.params.voltage_limit


def test_a_wheel_that_falls_is_counted_as_lost_and_the_others_as_if_alone(law, trial):
    states = trial.disturbed.copy()
    states[DTHETA, :3] += 20.0
    together = tuning.walked(law, states, 1.0)
    alone = tuning.walked(law, states[:, 7:8], 1.0)
    assert together.energy[7] == alone.energy[0]
    assert together.off[7] == alone.off[0]
    assert together.lasted[:3].max() < 0.99
    assert np.isinf(together.off[:3]).all()
    assert together.lasted[7] == pytest.approx(1.0)
    assert np.isfinite(together.off[7])


def test_a_law_that_walks_backwards_scores_like_one_that_falls(law, trial, one_step, monkeypatch):
    count = trial.gait.shape[1]

    def walked(gone, off):
        walks = tuning.Walks(np.ones(count), np.ones(count), np.full(count, gone), off)
        monkeypatch.setattr(tuning, "walked", lambda *args: walks)
        return tuning.score(law, one_step, trial)

    forwards, falls = walked(1.0, np.zeros(count)), tuning.DEARNESS
    assert walked(-1.0, np.zeros(count)) == falls
    assert walked(0.0, np.zeros(count)) == falls
    assert walked(1.0, np.full(count, np.inf)) > falls > 0.0
    assert forwards != falls


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"harmonics": -1}, ValueError),
        ({"wheels": 0}, ValueError),
        ({"generations": 1.5}, TypeError),
        ({"spread": 0.0}, ValueError),
        ({"seed": -1}, ValueError),
        ({"progress": 1}, TypeError),
    ],
)
def test_it_refuses_arguments_out_of_range(one_step, change, error):
    with pytest.raises(error, match=next(iter(change))):
        tuned.design(one_step, **SHORT | change)
