"""The gap of a walk to the environment's own optimum."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from agents.comparison.study import Study
from agents.conditions import Conditions
from agents.evaluate import Protocol, evaluate
from agents.gaps import (
    FRONT_STEPS,
    best_at_any_speed,
    best_held,
    gap_to_continuous_optimum,
    gap_to_front,
    gap_to_optimum,
    ticks_around,
)
from rimless_gym import BUILDABLE, PROTOTYPE
from rimless_gym.params import WheelParams
from trajopt import periodic_gait
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.gaits.library import shipped


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


def test_the_optimum_is_of_gaits_of_one_to_three_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved = []
    two_steps = next(gait for gait in shipped() if gait.steps == 2 and gait.params == BUILDABLE)

    def cot_front(params, speeds, steps, **settings):
        solved.append((tuple(steps), settings.get("hold")))
        return CotFront((two_steps,))

    monkeypatch.setattr("agents.gaps.cot_front", cot_front)
    assert best_held(BUILDABLE, 70, tmp_path) is two_steps
    assert solved == [((1, 2, 3), None), ((2,), 0.01)]
    assert Study().front_steps == FRONT_STEPS == (1, 2, 3)


@pytest.mark.slow
def test_the_gap_is_to_the_environments_own_optimum(tmp_path: Path) -> None:
    best = periodic_gait("BUILDABLE", 0.6354, 1, hold=0.01)
    walk = best.params, 1.1 * best.cot, best.speed, tmp_path
    assert gap_to_optimum(*walk) == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize("machine", [BUILDABLE, PROTOTYPE])
def test_the_best_gait_at_any_speed_is_found_from_afar_where_none_are_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, machine: WheelParams
) -> None:
    solved = []

    def best_held(params, ticks, *others):
        solved.append(ticks)
        return SimpleNamespace(cot=0.04 + 1e-5 * (ticks - 41) ** 2) if ticks > 39 else None

    monkeypatch.setattr("agents.gaps.best_held", best_held)
    gait = best_at_any_speed(machine, machine.step_length / 0.8, tmp_path)
    assert gait is not None
    assert gait.cot == 0.04
    assert len(solved) == len(set(solved)) < (6 if machine == BUILDABLE else 20)


def test_there_is_no_gap_where_nothing_walks_and_no_optimum_where_a_step_is_out_of_range(
    tmp_path: Path,
) -> None:
    assert gap_to_optimum(BUILDABLE, math.nan, math.nan, tmp_path) is None
    for ticks in (1, 2000):
        assert best_held(BUILDABLE, ticks, tmp_path) is None


def test_a_speed_lies_between_those_of_the_steps_around_it() -> None:
    fewer, more = ticks_around(BUILDABLE, 0.57)
    assert BUILDABLE.step_length / (0.01 * more) < 0.57 < BUILDABLE.step_length / (0.01 * fewer)
    for ticks in range(40, 120):  # a gait's own speed, rounded either way
        speed = BUILDABLE.step_length / (0.01 * ticks)
        for near in (np.nextafter(speed, 0.0), speed, np.nextafter(speed, 1.0)):
            assert ticks_around(BUILDABLE, near) == (ticks, ticks + 1)
    assert (ticks_around(BUILDABLE, None), ticks_around(BUILDABLE, -0.1)) == ((), ())


def test_the_gap_to_the_continuous_optimum_is_to_the_shipped_gaits_where_there_are_any() -> None:
    brief = Protocol(starts=1, duration=1.0, window=0.5, alive=0.5)
    standing = evaluate(lambda states, seen: np.zeros(len(states)), protocol=brief)
    usual = Conditions(BUILDABLE)
    slow, fast = (gait for gait in shipped_front(BUILDABLE).envelope if 0.56 < gait.speed < 0.61)
    halfway = {"speed": (slow.speed + fast.speed) / 2, "cot": 1.1 * (slow.cot + fast.cot) / 2}
    walks = dataclasses.replace(standing, **halfway)
    assert gap_to_continuous_optimum(walks, usual) == pytest.approx(0.1)
    drawn = Conditions.of(BUILDABLE, {"hub_friction": (0.01, 0.03)}, None)
    commanded = Conditions.of(BUILDABLE, None, None, (0.4, 0.6))
    for conditions in (Conditions(PROTOTYPE), drawn, commanded):
        assert math.isnan(gap_to_continuous_optimum(walks, conditions))
    for evaluation in (standing, dataclasses.replace(walks, speed=9.0)):
        assert math.isnan(gap_to_continuous_optimum(evaluation, usual))
