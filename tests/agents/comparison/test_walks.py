"""Deviations from the optimal cycle and return maps, of walks whose values are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.comparison.walks import (
    WalkedStep,
    deviations,
    last_middle,
    return_map,
    steps_of,
    touchdown_rates,
)
from agents.conditions import Conditions
from agents.rollout import Interval, Rollout
from rimless_gym import BUILDABLE
from rimless_gym.params import WheelParams
from scripts.studies.textbook import passive_wheel_rate
from trajopt.feedback.law import Floats
from trajopt.gaits.library import shipped
from trajopt.gaits.solution import Solution

LEGS, SLOPE = 8, 0.12
#: Just before a touchdown (rad/s).
RATE = passive_wheel_rate(LEGS, SLOPE) / math.cos(2 * math.pi / LEGS)
#: Rolls down the slope by itself.
BARE = WheelParams(
    n_legs=LEGS,
    slope=SLOPE,
    wheel_inertia=0.0,
    pendulum_length=0.0,
    pendulum_inertia=0.1,
    motor_constant=0.0,
)


def idle(states: Floats, observations: object) -> Floats:
    return np.zeros(len(states))


def walk(params: WheelParams, faster: float, seconds: float) -> list[Interval]:
    start = np.zeros((1, 6))
    start[0, [0, 2]] = params.constants.a + 1e-6, faster * passive_wheel_rate(LEGS, SLOPE)
    return list(Rollout(Conditions(params), idle, start, round(seconds / 0.01)))


@pytest.fixture(scope="module")
def gait() -> Solution:
    return next(g for g in shipped() if g.params == BUILDABLE and g.steps == 2)


def walked(gait: Solution, first: int, slower: float = 1.0) -> list[WalkedStep]:
    """Six steps of a gait, from one of its steps on, each longer by a factor."""
    steps = []
    for i in range(6):
        phase = gait.phases[(first + i) % gait.steps]
        times = np.arange(0.003, phase.duration, 0.01 / slower)
        states = phase.state(times) + np.array([0.0, 2 * math.pi * i, 0.0, 0.0])
        steps.append(WalkedStep(times / phase.duration, states))
    return steps


def test_what_is_added_to_a_walk_is_its_deviation(gait: Solution) -> None:
    added = np.array([1e-3, -2e-3, 3e-3, -4e-3])
    steps = [WalkedStep(phases, states + added) for phases, states in walked(gait, 0)]
    found = deviations(steps, gait)
    for each in found:
        np.testing.assert_allclose(each.states, np.tile(added, (len(each.states), 1)), atol=1e-9)


def test_steps_last_from_touchdown_to_touchdown() -> None:
    start = np.array([[BARE.constants.a + 0.1, 0.0, 2.5, 0.0, 0.0, 0.0]])
    intervals = list(Rollout(Conditions(BARE), idle, start, 200))
    steps = steps_of(intervals)
    assert len(steps) == sum(interval.info["steps"][0] for interval in intervals) - 1 > 2
    for step in steps:
        assert (np.diff(step.phases) > 0).all()
        assert 0.0 <= step.phases[0] < step.phases[-1] <= 1.0
        assert (np.diff(step.states[:, 0]) > 0).all()  # no touchdown within


def test_the_square_of_the_rate_comes_back_by_the_square_of_the_cosine() -> None:
    [rates] = touchdown_rates(BARE, idle, walk(BARE, 1.1, 0.01)[0].states, 5)
    share = math.cos(2 * math.pi / LEGS) ** 2
    before, after = rates[:-1] ** 2 - RATE**2, rates[1:] ** 2 - RATE**2
    np.testing.assert_allclose(after, share * before, rtol=1e-5)


def test_the_multipliers_are_those_of_the_cycle_and_of_what_nothing_brings_back() -> None:
    found = return_map(BARE, idle, walk(BARE, 1.0, 5.0))
    assert found.steady == pytest.approx(RATE, rel=1e-6)
    assert found.multipliers is not None
    sizes = [each.size for each in found.multipliers]
    assert sizes[:3] == pytest.approx([1.0] * 3, abs=0.01)  # time, and the free pendulum's two
    assert sizes[3] == pytest.approx(math.cos(2 * math.pi / LEGS) ** 2, abs=0.01)
    assert {each.sign for each in found.multipliers} == {1}
    assert np.isfinite(found.rates).all()


@pytest.mark.parametrize(("steps", "upright"), [(0, True), (-1, False)])
def test_a_leg_that_is_changed_out_of_double_stance_does_not_pass_the_vertical(
    steps: int, upright: bool
) -> None:
    [interval] = walk(BARE, 1.0, 0.01)
    after = interval.after.copy()
    after[0, 0] = BARE.constants.b
    counts = {"touchdowns": np.zeros(1), "steps": np.full(1, steps)}
    found = last_middle([interval._replace(after=after, info=counts)])
    assert (found is not None) == upright
