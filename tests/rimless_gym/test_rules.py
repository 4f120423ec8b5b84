"""The rules of walking: what breaks them, on which machines, and by how little."""

from __future__ import annotations

import math

import pytest

from rimless_gym import PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL
from rimless_gym.hybrid import pendulum_clearance
from rimless_gym.rules import (
    LIMIT_TOLERANCE,
    VIOLATIONS,
    Extremes,
    has_floor,
    least_clearance,
    may_touch,
    violations,
)

FINE = Extremes(
    min_normal_force=1.0, friction_demand=0.5, impulse_friction_demand=0.5, clearance=0.01
)
BETWEEN = PROTOTYPE.replace(pendulum_length=0.17)  # reaches 0.34 m; the hub is 0.30 to 0.375 m high


def test_a_walk_within_all_limits_breaks_no_rule() -> None:
    for params in (PROTOTYPE, BETWEEN, THESIS_PHYSICAL):
        assert violations(params, FINE) == ()


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ({"min_normal_force": 0.0}, ("lifts",)),
        ({"min_normal_force": -1.0, "friction_demand": math.inf}, ("lifts", "slips")),
        ({"friction_demand": 1 + 2 * LIMIT_TOLERANCE}, ("slips",)),
        ({"friction_demand": 1 + LIMIT_TOLERANCE / 2}, ()),
        ({"impulse_friction_demand": 1.01}, ("slips_at_touchdown",)),
        ({"clearance": -0.01}, ("touches",)),
        ({"clearance": -1e-5}, ()),
        ({"min_normal_force": math.nan}, ("lifts",)),
    ],
)
def test_each_limit_has_its_rule_and_its_tolerance(change: dict, broken: tuple) -> None:
    assert violations(BETWEEN.replace(friction=1.0), FINE._replace(**change)) == broken
    assert set(broken) <= set(VIOLATIONS)


def test_a_pendulum_as_long_as_a_leg_needs_a_track_and_has_no_floor_to_touch() -> None:
    deep = FINE._replace(clearance=-0.3)
    for params in (THESIS_NOMINAL, THESIS_PHYSICAL):
        assert not has_floor(params)
        assert not may_touch(params)
        assert violations(params, deep) == ()
    assert has_floor(BETWEEN)
    assert violations(BETWEEN, deep) == ("touches",)


def test_the_least_clearance_is_that_of_the_worst_pose() -> None:
    for params in (PROTOTYPE, BETWEEN, THESIS_PHYSICAL):
        p = params.constants
        poses = [
            float(pendulum_clearance(p.a + k / 20 * p.alpha, j / 10 * math.pi, p))
            for k in range(21)
            for j in range(-10, 11)
        ]
        assert least_clearance(params) == pytest.approx(min(poses), abs=1e-12)
    assert [may_touch(params) for params in (PROTOTYPE, BETWEEN)] == [False, True]
