"""The gap of a walk to the environment's own optimum."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agents.gaps import best_held, gap_to_front, gap_to_optimum, ticks_around
from rimless_gym import BUILDABLE
from trajopt import periodic_gait
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.shipped import shipped


def test_the_gap_is_taken_at_the_learned_speed_and_is_missing_off_the_front() -> None:
    gaits = [gait for gait in shipped() if gait.steps == 1]
    slow, fast = min(gaits, key=lambda g: g.speed), max(gaits, key=lambda g: g.speed)
    front = CotFront((slow, fast))
    middle = (slow.speed + fast.speed) / 2
    optimal = (slow.cot + fast.cot) / 2
    assert gap_to_front(1.25 * optimal, middle, front) == pytest.approx(0.25)
    assert gap_to_front(slow.cot, slow.speed, front) == pytest.approx(0.0)
    assert gap_to_front(1.0, fast.speed + 0.01, front) is None
    assert gap_to_front(None, None, front) is None


@pytest.mark.slow
def test_the_gap_is_to_the_environments_own_optimum_at_the_walked_speed() -> None:
    best = periodic_gait("THESIS_PHYSICAL", 0.5, 1, hold=0.01)
    found = gap_to_optimum(best.params, 1.1 * best.cot, best.speed)
    assert found == pytest.approx(0.1, abs=2e-3)


def test_there_is_no_gap_where_nothing_walks() -> None:
    assert gap_to_optimum(BUILDABLE, math.nan, math.nan) is None


@pytest.mark.parametrize("ticks", [1, 2000])
def test_there_is_no_optimum_where_a_step_is_too_short_or_too_long_to_solve(
    ticks: int, tmp_path: Path
) -> None:
    assert best_held(BUILDABLE, ticks, tmp_path) is None


def test_a_speed_lies_between_those_of_the_steps_around_it() -> None:
    fewer, more = ticks_around(BUILDABLE, 0.57)
    assert BUILDABLE.step_length / (0.01 * more) < 0.57 < BUILDABLE.step_length / (0.01 * fewer)
    assert (ticks_around(BUILDABLE, None), ticks_around(BUILDABLE, -0.1)) == ((), ())
