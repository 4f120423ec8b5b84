from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from scripts.studies.feedback_laws.linearisation import linearisation_conditions


def states(params, count=200):
    rng = np.random.default_rng(0)
    a, b = params.constants.a, params.constants.b
    return rng.uniform([a, -np.pi, -3, -12], [b, np.pi, 6, 12], (count, 4))


@pytest.mark.parametrize("params", [BUILDABLE, THESIS_PHYSICAL])
def test_the_voltage_reaches_every_direction(params):
    assert linearisation_conditions(params, states(params)).accessibility.min() > 1e-6


@pytest.mark.parametrize("params", [BUILDABLE, THESIS_PHYSICAL])
def test_no_change_of_state_and_voltage_makes_the_machine_linear(params):
    outside = linearisation_conditions(params, states(params)).involutivity
    assert outside.min() > 1e-6
    assert np.median(outside) > 1e-3


def test_a_reaction_wheel_in_the_pendulums_place_would_make_that_possible():
    wheel = THESIS_PHYSICAL.replace(pendulum_length=1e-9)
    conditions = linearisation_conditions(wheel, states(wheel))
    assert conditions.accessibility.min() > 1e-4
    assert np.median(conditions.involutivity) < 1e-6


def test_states_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"x: has shape \(3,\)"):
        linearisation_conditions(THESIS_PHYSICAL, np.zeros(3))
