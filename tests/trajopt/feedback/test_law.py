"""What a law is, how it is designed by its name, and which arguments are refused."""

from __future__ import annotations

import dataclasses
import warnings
from typing import NamedTuple

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import DOUBLE
from rimless_gym.jit import inner
from trajopt.feedback import laws, startup
from trajopt.feedback.controller import SwitchingController
from trajopt.feedback.law import Law
from trajopt.feedback.laws import input_output, lqr, pid, receding_horizon, sliding_mode, tuned
from trajopt.feedback.orbit import Orbit, between, located
from trajopt.feedback.transverse import multipliers

P = THESIS_PHYSICAL
EACH = {each.__name__.split(".")[-1]: each for each in (input_output, lqr, pid, sliding_mode)}
EACH |= {"receding_horizon": receding_horizon, "tuned": tuned}


class Data(NamedTuple):
    orbit: Orbit


@inner
def open_loop(x, mode, data):
    """The gait's own voltage, and no feedback."""
    return between(data.orbit.voltages, located(x, data.orbit))


def test_a_law_is_a_function_of_the_state_within_the_voltage_limit(law, held):
    x = np.random.default_rng(0).uniform([1.0, -3, -1, -5], [2.0, 3, 2, 5], (10, 4))
    together = law(x, np.zeros(10, int))
    assert np.array_equal(together, [law(state) for state in x])
    assert np.allclose(together, law(x + [0, 2 * np.pi, 0, 0]))
    assert np.abs(together).max() <= P.voltage_limit
    assert law(held.state(0.1), DOUBLE) == law(held.state(0.1))


def test_a_law_from_elsewhere_gets_the_start_up_controller_and_the_guard(law, held, monkeypatch):
    monkeypatch.setattr(startup, "startup_for", lambda *args: lambda x, mode: 0 * x[:, 0])
    controller = laws.design(law, held)
    assert controller.controller.law is law
    farther = laws.design(dataclasses.replace(law, reach=2.0), held)
    assert farther.controller.near == 2.0 * controller.controller.near
    assert controller(held.state(0.3)) == law(held.state(0.3))


def test_a_law_that_does_not_hold_its_gait_causes_a_warning_with_its_multiplier(law, held):
    unstable = Law(P, open_loop, Data(law.data.orbit))
    largest = multipliers(unstable, held)[0]
    with pytest.warns(UserWarning, match=f"grows {largest:.3g}-fold in a stride"):
        assert laws.holding(unstable, held) is unstable
    assert largest > 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        laws.holding(law, held)


@pytest.mark.parametrize("design", [each.design for each in EACH.values()], ids=EACH)
def test_no_law_takes_a_gait_that_failed_its_verification(design, held):
    verification = dataclasses.replace(held.verification, failures=("the foot slips",))
    with pytest.raises(ValueError, match=r"failed its verification \(the foot slips\)"):
        design(dataclasses.replace(held, verification=verification))


def other(law):
    """The law for another machine."""
    return Law(P.replace(wheel_mass=2.0), law.volts, law.data)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda law, gait: laws.holding("lqg", gait), ValueError, "'lqg': choose from .*'lqr'"),
        (lambda law, gait: laws.design(gait, "lqr"), TypeError, r"must be one of .*'lqr'"),
        (lambda law, gait: laws.holding(other(law), gait), ValueError, "another machine: {'wheel"),
        (lambda law, gait: SwitchingController(law, other(law)), ValueError, "another machine"),
        (lambda law, gait: lqr.design(gait, gentle=-1.0), ValueError, "gentle = -1.0: must be"),
        (lambda law, gait: Law(P, lambda x, m, d: 0.0, law.data), TypeError, "compiled; put @inn"),
        (lambda law, gait: Law(P, law.volts, ()), TypeError, "has no field orbit; add one"),
        (lambda law, gait: law(np.zeros(3)), ValueError, r"x: has shape \(3,\)"),
        (lambda law, gait: law(np.zeros((1, 4)), 2), ValueError, "mode = 2: must be 0 .*or 1"),
        (lambda law, gait: law([0.0, np.nan, 0.0, 0.0]), ValueError, "x: has .*nan"),
    ],
)
def test_arguments_are_refused_with_value_limit_and_remedy(call, error, message, law, held):
    with pytest.raises(error, match=message):
        call(law, held)
