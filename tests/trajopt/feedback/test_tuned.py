"""The LQR with tuned numbers: whose walks count, and what evolution makes of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym.kernel.stepping import DTHETA
from trajopt.feedback.gait_table import law_about
from trajopt.feedback.laws import tuned


@pytest.fixture(scope="module")
def gentle(held):
    return law_about(held, ahead=None)


@pytest.fixture
def short(monkeypatch):
    for name, value in {"MACHINES": 8, "DURATION": 2.0, "WINDOW": 1.0}.items():
        monkeypatch.setattr(tuned, name, value)


def drawn(held, share, seed=0):
    return tuned.Trial.drawn(held, share, np.random.default_rng(seed))


def test_zeros_leave_the_lqr_as_it_is_and_other_numbers_do_not(gentle, held):
    zeros = np.zeros(tuned.COUNT)
    laws = [tuned.law_with(held, q) for q in (zeros, zeros + 0.1)]
    same, changed = (law.data for law in laws)
    assert all(law.reach == tuned.REACH > gentle.reach for law in laws)
    for name in ("voltages", "gentle", "firm", "blend"):
        assert np.array_equal(getattr(same, name), getattr(gentle.data, name))
        assert not np.array_equal(getattr(changed, name), getattr(gentle.data, name))


def test_every_machine_walks_as_if_alone_and_one_that_falls_stops_no_other(gentle, held, short):
    trial = drawn(held, 0.02)
    states = np.ascontiguousarray(trial.states)
    states[DTHETA, [0, 3]] += 60.0  # these two fall
    together = tuned.walking_costs(gentle, trial.machines, states)
    assert np.flatnonzero(np.isinf(together)).tolist() == [0, 3]
    for k in (1, 7):
        alone = tuned.walking_costs(gentle, trial.machines[k : k + 1], states[:, k : k + 1])
        assert alone[0] == together[k]


def test_on_the_nominal_machine_the_cost_is_the_gaits_own(gentle, held, monkeypatch):
    monkeypatch.setattr(tuned, "MACHINES", 8)
    monkeypatch.setattr(tuned, "DURATION", 1.0 + 4 * held.duration)
    monkeypatch.setattr(tuned, "WINDOW", 4 * held.duration)
    trial = drawn(held, 0.0)
    assert set(trial.machines) == {held.params}
    costs = tuned.walking_costs(gentle, trial.machines, trial.states)
    assert costs.mean() == pytest.approx(held.cot, rel=0.02)
    assert trial.loss(gentle) == pytest.approx(np.log(costs.mean()))


def test_a_walk_that_slips_does_not_count(gentle, held, short):
    trial = drawn(held, 0.0)
    glassy = [dataclasses.replace(each, friction=0.3) for each in trial.machines]
    assert np.isfinite(tuned.walking_costs(gentle, trial.machines, trial.states)).all()
    assert np.isinf(tuned.walking_costs(gentle, glassy, trial.states)).all()
    assert trial._replace(machines=tuple(glassy)).loss(gentle) > trial.loss(gentle) + 9.0


def test_a_law_is_tuned_once_for_a_folder(held, monkeypatch, tmp_path):
    found = []

    def tune(solution):
        found.append(np.full(tuned.COUNT, 0.1 * (1 + len(found))))
        return found[-1]

    monkeypatch.setattr(tuned, "tune", tune)
    other = dataclasses.replace(held, params=held.params.replace(friction=0.9))
    several = [tuned.design(gait, tmp_path).data.voltages for gait in (held, held, other)]
    assert np.array_equal(several[0], several[1])
    assert not np.array_equal(several[0], several[2])
    assert len(found) == 2


@pytest.mark.slow
def test_evolution_costs_less_on_other_machines_and_the_same_for_the_same_seed(
    gentle, held, monkeypatch
):
    monkeypatch.setattr(tuned, "MACHINES", 24)
    np.random.seed(5)  # noqa: NPY002
    wanted = np.random.random()  # noqa: NPY002
    np.random.seed(5)  # noqa: NPY002
    numbers, again, other = (tuned.tune(held, 0.02, 20, seed) for seed in (0, 0, 1))
    assert np.random.random() == wanted  # noqa: NPY002
    trial = drawn(held, 0.02, seed=9)
    assert trial.loss(tuned.law_with(held, numbers)) < trial.loss(gentle)
    assert np.array_equal(again, numbers)
    assert not np.array_equal(other, numbers)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"share": 1.0}, "share = 1.0: must be at least 0 and less than 1"),
        ({"generations": -1}, "generations = -1"),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_numbers_out_of_range_are_refused(held, changes, message):
    with pytest.raises(ValueError, match=message):
        tuned.tune(held, **changes)
