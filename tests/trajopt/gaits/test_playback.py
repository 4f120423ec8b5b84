"""A control played back is the control of the phases, each over its own time."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from trajopt.gaits.library import nearest, shipped
from trajopt.gaits.verify import playback, simulated, simulated_stride

GAIT = nearest(THESIS_PHYSICAL, 0.5, 2)[0]


def test_phases_of_different_control_degrees_are_played_one_after_the_other() -> None:
    first, second = GAIT.phases
    volts = np.linspace(0.0, 3.0, len(second.controls))[:, None, None]  # constant in each element
    second = dataclasses.replace(
        second, control_nodes=np.array([0.0, 1.0]), controls=np.repeat(volts, 2, axis=1)
    )
    breakpoints, law = playback([first, second])
    assert breakpoints[-1] == pytest.approx(GAIT.duration)
    assert len(breakpoints) == len(first.controls) + len(second.controls)
    for t in np.linspace(0.0, 0.999 * first.duration, 50):
        assert law(t, None) == pytest.approx(first.control(t)[0, 0], abs=1e-9)
    for t in np.linspace(0.001, 0.999 * second.duration, 50):
        expected = second.control(t)[0, 0]
        assert law(first.duration + t, None) == pytest.approx(expected, abs=1e-9)


def test_playback_is_extended_just_far_enough_for_the_last_touchdown() -> None:
    early, late, later = -1e-6, 1e-6, 1e-3
    assert simulated(GAIT.params, GAIT.phases, GAIT.duration + early).steps == 1
    run = simulated_stride(GAIT.params, GAIT.phases, (early, late, later))
    assert run.steps == 2
    assert run.t[-1] == pytest.approx(GAIT.duration + late, abs=1e-12)


def test_around_a_touchdown_the_state_shows_which_steps_voltage_acts() -> None:
    first, second = GAIT.phases
    _, law = playback(GAIT.phases)
    before, after = first.end, second.start
    last, next_ = first.control([first.duration], "left")[0, 0], second.control(0.0)[0, 0]
    assert last != pytest.approx(next_)
    for t in (first.duration - 1e-9, first.duration + 1e-9):
        assert law(t, before) == pytest.approx(last, abs=1e-5)
        assert law(t, after) == pytest.approx(next_, abs=1e-5)
    assert law(first.duration + 1e-4, before) == law(first.duration + 1e-4, None)


def test_after_the_last_touchdown_the_next_strides_voltage_is_played() -> None:
    gait = next(g for g in shipped() if abs(g.control(0.0) - g.control(g.duration, "left")) > 1.0)
    run = simulated_stride(gait.params, gait.phases, [1e-6])
    assert run.t[-1] > run.touchdowns[-1].time
    assert run.u[-1] == pytest.approx(gait.control(0.0), abs=1e-3)
