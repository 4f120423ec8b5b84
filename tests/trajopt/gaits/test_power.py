"""Losses that no voltage overcomes are told at once, and only where there is no gait."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rimless_gym import THESIS_PHYSICAL, simulate
from trajopt import NoGaitError, periodic_gait
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.library import shipped
from trajopt.gaits.problem import lacks_power, least_mean_rate, most_power_at_hub

P = THESIS_PHYSICAL


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"hub_damping": 100.0}, "hub_damping = 100"),
        ({"voltage_limit": 0.5}, "voltage_limit = 0.5 V"),
        ({"drag": 1000.0}, "drag = 1000"),
        ({"hub_friction": 50.0}, "hub_friction = 50"),
        ({"slope": -1.0, "gear_ratio": 5.0, "voltage_limit": 5.0}, "slope = -1"),
    ],
)
def test_a_walk_beyond_the_motors_power_is_refused_with_value_and_remedy(
    changes: dict, told: str
) -> None:
    with pytest.raises(NoGaitError, match="the motor is too weak") as refused:
        periodic_gait(P.replace(**changes), 0.5, 2)
    assert told in str(refused.value)
    assert "raise voltage_limit" in str(refused.value)


def test_no_gait_that_exists_is_refused() -> None:
    for gait in shipped():
        assert lacks_power(gait.params, gait.speed, gait.steps) == ""


def test_psi_turns_on_average_as_fast_as_in_any_gait_or_less() -> None:
    for gait in shipped():
        turned = gait.steps * gait.params.leg_angle + 2 * math.pi * gait.theta_turns
        least = least_mean_rate(gait.params, gait.speed, gait.steps)
        assert least <= abs(turned) / gait.duration + 1e-12


@pytest.mark.parametrize("law", ["thesis", "relabel"])
def test_laws_whose_touchdowns_may_create_energy_are_never_refused(law: str) -> None:
    assert lacks_power(P.replace(hub_damping=100.0), 0.5, 1) != ""
    assert lacks_power(P.replace(hub_damping=100.0, impact_law=law), 0.5, 1) == ""


@settings(max_examples=8)
@given(
    *(st.floats(0.0, 20.0), st.sampled_from([(0.0, 0.0), (0.5, 0.0), (0.2, 0.3)])),
    *(st.floats(1.0, 20.0), st.integers(0, 2**32 - 1)),
)
def test_no_motion_takes_more_power_from_the_hub_than_its_mean_rate_allows(
    damping: float, dry: tuple[float, float], limit: float, seed: int
) -> None:
    changes = dict(zip(("hub_friction", "gear_loss"), dry, strict=True))
    params = P.replace(hub_damping=damping, voltage_limit=limit, **changes)
    rng = np.random.default_rng(seed)
    volts, fast = rng.uniform(-limit, limit, 30), rng.uniform(-20.0, 20.0)
    run = simulate(params, [1.4, 0.5, 0.5, fast], volts, 0.3)
    ledger, t = run.ledger, np.linspace(0.0, run.t[-1], 3001)
    lost = ledger.losses
    fed = ledger.electrical - lost.copper - lost.damping - lost.friction - lost.gear
    x = run.state(t)
    mean = np.abs(x[:, 2] + x[:, 3]).mean()
    assert fed / run.t[-1] <= most_power_at_hub(params, 0.999 * mean) + 1e-3


@pytest.mark.parametrize("solve", [periodic_gait, partial(cot_front, speeds=[0.5])])
def test_a_machine_may_be_named_and_must_exist(solve: Callable) -> None:
    with pytest.raises(ValueError, match="unknown preset 'CONCRETE': choose from"):
        solve("CONCRETE")
    with pytest.raises(TypeError, match="params = 3: give a WheelParams, a preset's name"):
        solve(3)
    with pytest.raises(NoGaitError, match="hub_damping = 100"):
        solve({"hub_damping": 100.0})
