"""The switch between a law and a start-up controller, and the guard of the contact."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.symbolic import HybridModel
from trajopt.feedback import laws, startup
from trajopt.feedback.controller import (
    CONTACT_MARGIN,
    NEAR,
    ContactGuard,
    SwitchingController,
    margin_for,
)
from trajopt.feedback.orbit import squared_distances

P = THESIS_PHYSICAL


class Recording:
    """A controller of one voltage that records its states."""

    def __init__(self, volts: float) -> None:
        self.volts, self.states = volts, []

    def __call__(self, x, mode):
        self.states += list(zip(x[:, 0], mode, strict=True))
        return np.full(len(x), self.volts)


def test_the_law_acts_near_its_gait_and_the_start_up_controller_elsewhere(law, held):
    class RecordingLaw(Recording):
        params, data = law.params, law.data

    switching = SwitchingController(RecordingLaw(1.0), Recording(2.0))
    near, far = held.state(0.3), held.state(0.3) + [0.0, 1.0, 1.0, 1.0]
    assert switching(near) == 1.0
    assert switching.startup.states == []
    x, modes = np.array([near, far, near, far]), np.array([SINGLE, SINGLE, DOUBLE, DOUBLE])
    distances = np.sqrt(squared_distances(x, law.data.orbit))
    assert distances[0] < NEAR < distances[1]
    assert switching(x, modes).tolist() == [1.0, 2.0, 2.0, 2.0]
    assert switching.law.states == 2 * [(near[0], SINGLE)]
    assert switching.startup.states == [(far[0], SINGLE), (near[0], DOUBLE), (far[0], DOUBLE)]


@pytest.mark.parametrize("wanted", [-20.0, 0.0, 20.0])
def test_the_guard_changes_a_voltage_only_to_keep_the_foot_pressed_down(wanted):
    rng = np.random.default_rng(2)
    x = rng.uniform([P.constants.a, -3, -1, -8], [P.constants.b, 3, 2, 8], (400, 4))
    reaction = HybridModel(P).functions["ground_reaction"].map(len(x))

    def force(volts):
        return np.asarray(reaction(x.T, volts[None]))[1]

    volts = ContactGuard(P, lambda x, mode: np.full(len(x), wanted))(x, np.zeros(len(x), int))
    floor = 0.1 * P.weight
    before, after = force(np.full(len(x), wanted)), force(volts)
    changed = volts != wanted
    assert np.abs(volts).max() <= P.voltage_limit
    assert np.array_equal(changed, (before < floor) & (after > before))
    within = changed & (np.abs(volts) < P.voltage_limit)
    assert after[within] == pytest.approx(floor)
    assert changed.sum() > 5


def test_the_guard_of_a_gait_that_hardly_presses_does_not_act_on_the_gait_itself(held, monkeypatch):
    v = held.verification
    light = dataclasses.replace(v, min_normal_force_over_weight=0.05)
    assert margin_for(held) == CONTACT_MARGIN < v.min_normal_force_over_weight
    light_gait = dataclasses.replace(held, verification=light)
    assert margin_for(light_gait) == pytest.approx(0.03)
    monkeypatch.setattr(startup, "startup_for", lambda *args: lambda x, mode: 0 * x[:, 0])
    assert laws.design("lqr", light_gait).margin == pytest.approx(0.03)


@pytest.mark.parametrize(
    "given", [lambda x: np.where(x[:, 1] > 0.4, np.nan, 0.0), lambda x: 0.0, lambda x: np.zeros(3)]
)
def test_a_controller_that_gives_no_voltages_is_refused(given):
    x = np.array([[1.5, 0.0, 0.0, 0.0], [1.5, 0.5, 0.0, 0.0]])
    with pytest.raises(ValueError, match=r"controller: gave .* for 2 states; must give one"):
        ContactGuard(P, lambda x, mode: given(x))(x)
