from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.symbolic import HybridModel
from trajopt.feedback import laws
from trajopt.feedback.catch import catch
from trajopt.feedback.guard import CONTACT_MARGIN, Guarded, margin_for

P = THESIS_PHYSICAL


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


def test_the_guard_of_a_gait_that_hardly_presses_does_not_act_on_the_gait_itself(held, monkeypatch):
    v = held.verification
    light = dataclasses.replace(v, min_normal_force_over_weight=0.05)
    assert margin_for(held) == CONTACT_MARGIN < v.min_normal_force_over_weight
    light_gait = dataclasses.replace(held, verification=light)
    assert margin_for(light_gait) == pytest.approx(0.03)
    monkeypatch.setattr(catch, "catch_for", lambda *args: lambda x, mode: 0 * x[:, 0])
    assert laws.design("lqr", light_gait).margin == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("margin", "error", "message"),
    [
        (np.nan, ValueError, "margin = nan: must be finite"),
        (1e9, ValueError, "margin = 1000000000.0: must be at least 0 and less than 1"),
        ("a", TypeError, "margin = 'a': must be a real number"),
    ],
)
def test_a_margin_that_makes_no_sense_is_refused(margin, error, message):
    with pytest.raises(error, match=message):
        Guarded(P, lambda x, mode: 0 * x[:, 0], margin)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda x: np.where(x[:, 1] > 0.4, np.nan, 0.0), r"gave NaN for the state \[1.5 0.5"),
        (lambda x: 0.0, r"voltages of shape \(\) .* must have shape \(2,\)"),
        (lambda x: np.zeros(3), r"voltages of shape \(3,\) .* must have shape \(2,\)"),
    ],
)
def test_a_controller_that_gives_no_voltages_is_named(given, message):
    x = np.array([[1.5, 0.0, 0.0, 0.0], [1.5, 0.5, 0.0, 0.0]])
    with pytest.raises(ValueError, match=message):
        Guarded(P, lambda x, mode: given(x))(x)
