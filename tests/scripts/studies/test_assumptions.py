"""The study of the machine's assumptions."""

from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from scripts.studies.assumptions import TIME_CONSTANT, ripple_loss
from trajopt.gaits.library import warm_starts


def test_the_ripples_loss_is_that_of_a_current_that_goes_up_and_down_in_straight_lines() -> None:
    gait, frequency = warm_starts(BUILDABLE, 0.6, 1, 1)[0], 20e3
    inductance = TIME_CONSTANT * BUILDABLE.armature_resistance
    parts, squares = (np.arange(1000) + 0.5) / 1000, []
    for volts in abs(gait.control(np.linspace(0.0, gait.duration, 300, endpoint=False))):
        switched = np.where(parts < volts / BUILDABLE.voltage_limit, BUILDABLE.voltage_limit, 0.0)
        squares.append(np.var(np.cumsum(switched - volts) / (1000 * frequency * inductance)))
    lost = BUILDABLE.armature_resistance * np.mean(squares)
    assert ripple_loss(gait, frequency) == pytest.approx(lost, rel=0.02)
