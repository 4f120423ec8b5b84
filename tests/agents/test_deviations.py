"""Deviations from the optimal cycle: none of the gait itself, those that are put in of another."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.comparison.deviations import Step, deviation_charts, deviations, steps_of
from agents.conditions import Conditions
from agents.rollout import Rollout
from rimless_gym import BUILDABLE, WheelParams
from trajopt.gaits.library import shipped
from trajopt.gaits.solution import Solution


@pytest.fixture(scope="module")
def gait() -> Solution:
    return next(g for g in shipped() if g.params == BUILDABLE and g.steps == 2)


def walked(gait: Solution, first: int, slower: float = 1.0) -> list[Step]:
    """Six steps of a gait, from one of its steps on, each longer by a factor."""
    steps = []
    for i in range(6):
        phase = gait.phases[(first + i) % gait.steps]
        times = np.arange(0.003, phase.duration, 0.01 / slower)
        states = phase.state(times) + np.array([0.0, 2 * math.pi * i, 0.0, 0.0])
        steps.append(Step(times / phase.duration, states))
    return steps


@pytest.mark.parametrize("first", [0, 1])
def test_the_gait_itself_deviates_by_nothing_whatever_step_it_begins_with(
    gait: Solution, first: int
) -> None:
    for found in deviations(walked(gait, first), gait):
        np.testing.assert_allclose(found.states, 0.0, atol=1e-9)


def test_states_are_compared_at_equal_shares_of_the_step(gait: Solution) -> None:
    for found in deviations(walked(gait, 0, slower=1.1), gait):
        np.testing.assert_allclose(found.states, 0.0, atol=1e-9)


def test_what_is_added_to_a_walk_is_its_deviation(gait: Solution) -> None:
    added = np.array([1e-3, -2e-3, 3e-3, -4e-3])
    steps = [Step(phases, states + added) for phases, states in walked(gait, 0)]
    found = deviations(steps, gait)
    for each in found:
        np.testing.assert_allclose(each.states, np.tile(added, (len(each.states), 1)), atol=1e-9)
    charts = deviation_charts({"law": (found, "teal")}, "at 0.5 m/s")
    [line] = charts[1].series
    assert charts[1].title == "pendulum angle theta, at 0.5 m/s"
    assert np.nanmin(line.y) == pytest.approx(-2.0)  # mrad
    assert np.isnan(line.points[1]).sum() == len(steps)  # no line from one step to the next


def test_steps_last_from_touchdown_to_touchdown() -> None:
    bare = {"wheel_inertia": 0.0, "pendulum_length": 0.0, "motor_constant": 0.0}
    params = WheelParams(n_legs=8, slope=0.12, pendulum_inertia=0.1, **bare)  # rolls by itself
    start = np.array([[params.constants.a + 0.1, 0.0, 2.5, 0.0, 0.0, 0.0]])
    walk = list(Rollout(Conditions(params), lambda states, seen: np.zeros(len(states)), start, 200))
    steps = steps_of(walk)
    assert len(steps) == sum(interval.info["steps"][0] for interval in walk) - 1 > 2
    for step in steps:
        assert (np.diff(step.phases) > 0).all()
        assert 0.0 <= step.phases[0] < step.phases[-1] <= 1.0
        assert (np.diff(step.states[:, 0]) > 0).all()  # no touchdown within
