"""What laws require of a gait, and of what a law of one's own is made of."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.jit import inner
from trajopt.feedback import laws
from trajopt.feedback.catch import catch
from trajopt.feedback.closed_loop import multipliers
from trajopt.feedback.law import Law
from trajopt.feedback.laws import (
    input_output,
    lqr,
    pid,
    receding_horizon,
    sliding_mode,
    tuned,
)
from trajopt.feedback.orbit import Orbit, between, located

P = THESIS_PHYSICAL


class Data(NamedTuple):
    orbit: Orbit


@inner
def played_back(x, mode, data):
    """The gait's own voltage, and no feedback."""
    return between(data.orbit.voltages, located(x, data.orbit))


@pytest.fixture(scope="module")
def law(held):
    return lqr.design(held)


@pytest.fixture(scope="module")
def unstable(law):
    return Law(P, played_back, Data(law.data.orbit))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of laws besides the package's."""
    monkeypatch.setattr(laws, "__path__", [*laws.__path__, str(tmp_path)])
    return tmp_path


@pytest.mark.parametrize(
    "design",
    [each.design for each in (input_output, lqr, pid, receding_horizon, sliding_mode, tuned)],
    ids=lambda design: design.__module__.split(".")[-1],
)
def test_no_law_takes_a_gait_that_failed_its_verification(design, held):
    verification = dataclasses.replace(held.verification, failures=("the foot slips",))
    failed = dataclasses.replace(held, verification=verification)
    with pytest.raises(ValueError, match=r"failed its verification \(the foot slips\)"):
        design(failed)


@pytest.mark.parametrize(
    ("ahead", "error"), [(np.nan, ValueError), (-1.0, ValueError), ("x", TypeError)]
)
@pytest.mark.parametrize("design", [lqr.design, sliding_mode.design])
def test_the_clocks_time_is_checked_where_there_is_no_clock_too(design, ahead, error, one_step):
    with pytest.raises(error, match="ahead = "):
        design(one_step, ahead=ahead)


def test_a_law_has_a_short_repr(law, held):
    n = len(law.data.orbit.states)
    assert repr(law) == f"Law(THESIS_PHYSICAL, {lqr.__name__}.volts, orbit of {n} nodes)"
    heavier = Law(P.replace(wheel_mass=2.0), law.volts, law.data)
    assert "Law(THESIS_PHYSICAL but for wheel_mass, " in repr(heavier)


def test_a_law_of_ones_own_gets_the_catch_and_the_guard(law, held, monkeypatch):
    monkeypatch.setattr(catch, "catch_for", lambda *args: lambda x, mode: 0 * x[:, 0])
    controller = laws.design(law, held)
    assert controller.controller.law is law
    assert controller(held.state(0.3)) == law(held.state(0.3))


def test_arguments_in_the_wrong_order_are_refused_in_one_short_line(held):
    with pytest.raises(TypeError, match=r"must be one of .*'lqr'") as raised:
        laws.design(held, "lqr")
    assert len(str(raised.value)) < 300
    assert "\n" not in str(raised.value)


def test_a_law_that_is_not_compiled_or_has_no_orbit_says_what_to_add(law):
    with pytest.raises(TypeError, match="must be compiled; put @inner"):
        Law(P, lambda x, mode, data: 0.0, law.data)
    with pytest.raises(TypeError, match=r"data = \(\): has no field orbit; add one"):
        Law(P, law.volts, ())


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("", r"helper.py: has no function design"),
        ("def design(solution): return 3", r"returner.py: design returned 3; must return a"),
    ],
)
def test_a_file_in_the_folder_that_is_no_law_is_named(source, message, folder, held):
    name = message.split(".")[0]
    (folder / f"{name}.py").write_text(source + "\n")
    with pytest.raises(ValueError, match=message):
        laws.holding(name, held)


def test_a_law_that_does_not_hold_its_gait_is_warned_of_with_its_multiplier(unstable, held):
    largest = multipliers(unstable, held)[0]
    with pytest.warns(UserWarning, match=f"grows {largest:.3g}-fold in a stride"):
        assert laws.holding(unstable, held) is unstable
    assert largest > 1.0


def test_a_law_that_holds_its_gait_is_not_warned_of(law, held):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        laws.holding(law, held)
