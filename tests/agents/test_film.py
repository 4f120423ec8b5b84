"""Recordings of walks, and their pictures: one alone, several in one, and where the energy goes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from agents.film import (
    AHEAD,
    STEPS,
    GroupFilm,
    Recording,
    drawn,
    ghost,
    record,
    record_gait,
    record_policy,
    spending,
)
from agents.policy_files import NamedPolicy, named_policy
from agents.rollout import Interval, Rollout, at_rest
from rimless_gym import BUILDABLE
from rimless_gym.equations import DOUBLE, LOSSES
from rimless_gym.kernel.stepping import FOOT, PHI
from trajopt import periodic_gait
from trajopt.gaits.solution import Solution

SECONDS = 6.0


@pytest.fixture(scope="module")
def policy() -> NamedPolicy:
    return named_policy("evolution", lambda params: pytest.fail("no gait is needed"))


@pytest.fixture(scope="module")
def intervals(policy: NamedPolicy) -> list[Interval]:
    n = round(SECONDS / 0.01)
    return list(Rollout(policy.conditions, policy.policy, at_rest(BUILDABLE)[None], n))


@pytest.fixture(scope="module")
def walk(intervals: list[Interval]) -> Recording:
    return record("evolution", intervals, BUILDABLE, 0.01)


@pytest.fixture(scope="module")
def gait() -> Solution:
    return periodic_gait(BUILDABLE, 0.56, 1, hold=0.01)


# -- recordings ------------------------------------------------------------------------------------


def test_the_wheel_is_where_it_was_and_spent_the_sum_of_info(
    walk: Recording, intervals: list[Interval]
) -> None:
    for k in (0, 1, 317, 599):
        for time in (0.01 * k, 0.01 * k + 0.009):
            scene, state = walk.pose(time), intervals[k].states[0]
            assert scene.phi == state[PHI]
            assert scene.foot_x == state[FOOT] * BUILDABLE.step_length
            assert scene.voltage == 12.0 * intervals[k].actions[0]
    assert walk.pose(0.0).mode == DOUBLE
    assert walk.pose(99.0).phi == intervals[-1].after[0, PHI]  # it stays where it ended
    for name in ("electrical", "copper", "friction", "gear", "collision", "idle", "distance"):
        total = sum(float(each.info[name][0]) for each in intervals[:250])
        assert walk.spent(2.5)[name] == pytest.approx(total, abs=1e-12)


def test_there_are_no_figures_before_some_steps_in_a_row_nor_after_the_wheel_stops(
    walk: Recording,
) -> None:
    first = walk.measured_from
    assert first is not None
    steps = [end for end in walk.touchdowns if end.time <= first.time][-STEPS - 1 :]
    assert len(steps) == STEPS + 1
    assert all(after.foot == before.foot + 1 for before, after in itertools.pairwise(steps))
    assert first.time > 2.0
    for time in np.arange(0.0, first.time - 1e-6, 0.1):
        assert walk.figures(time) is None
        assert walk.scene(time).cot is None
    assert walk.figures(walk.touchdowns[-1].time + 1.9) is not None
    assert walk.figures(walk.touchdowns[-1].time + 2.1) is None


def test_the_figures_are_those_of_the_last_steps(walk: Recording) -> None:
    ends = [end.time for end in walk.touchdowns if end.time <= 5.0][-STEPS - 1 :]
    figures = walk.figures(5.0)
    assert figures is not None
    before, after = (walk.spent(round(time, 2)) for time in (ends[0], ends[-1]))
    spent = {name: after[name] - before[name] for name in before}
    speed = STEPS * BUILDABLE.step_length / (ends[-1] - ends[0])
    assert figures.speed == pytest.approx(speed, rel=1e-2)
    energy = spent["electrical_positive"] + spent["idle"]
    assert figures.cot == pytest.approx(energy / (BUILDABLE.weight * spent["distance"]), rel=5e-2)


def test_a_policy_is_recorded_from_rest_for_at_least_one_interval(
    policy: NamedPolicy, walk: Recording
) -> None:
    brief = record_policy(policy, 0.2)
    assert np.array_equal(brief.states, walk.states[:21])
    assert (brief.name, brief.begins, brief.ends) == ("evolution", 0.0, pytest.approx(0.2))
    assert len(record_policy(policy, 0.001).volts) == 1


def test_a_recorded_gait_is_its_solution_and_costs_what_was_verified(gait: Solution) -> None:
    begins, legs = 0.437, 3
    recording = record_gait("optimum", gait, 5.0, begins, legs)
    assert recording.begins == pytest.approx(0.44)
    for time in (0.44, 0.5, 1.03, 3.99):
        scene, state = recording.pose(time), gait.state(time - begins)
        assert (scene.phi, scene.theta) == pytest.approx(tuple(state[:2]), abs=1e-9)
        steps = int((time - begins) / gait.duration)
        assert scene.foot_x == pytest.approx((legs + steps) * BUILDABLE.step_length)
    hubs = [recording.pose(time).hub(BUILDABLE)[0] for time in np.arange(0.44, 4.0, 0.01)]
    assert (np.diff(hubs) > 0.0).all()
    figures = recording.figures(4.9)
    assert figures is not None
    assert figures.speed == pytest.approx(gait.speed, rel=1e-3)
    assert figures.cot == pytest.approx(gait.cot, rel=1e-3)


# -- pictures --------------------------------------------------------------------------------------


def blue(frame: Any) -> int:
    """How many pixels are as blue as nothing but the optimum and its name."""
    return int((frame[..., 2].astype(int) - frame[..., 1] > 30).sum())


def test_the_optimum_joins_in_step_once_the_first_walks(walk: Recording, gait: Solution) -> None:
    optimum, first = ghost(gait, walk), walk.measured_from
    assert first is not None
    assert 0.0 <= optimum.begins - first.time < 0.01
    assert optimum.touchdowns[0] == pytest.approx((first.time, 1, first.foot + AHEAD))
    alone, both = GroupFilm([walk]), GroupFilm([walk, optimum], (501, 333))
    frames = [both.frame(t) for t in (0.0, optimum.begins - 0.1, 5.0)]
    assert all(frame.shape == (333, 501, 3) and frame.dtype == np.uint8 for frame in frames)
    assert blue(frames[2]) > 500
    assert blue(frames[1]) == blue(alone.frame(5.0)) == 0


@pytest.mark.parametrize("time", [0.5, 3.0, 6.0])
def test_the_terms_add_up_to_what_the_battery_gave(walk: Recording, time: float) -> None:
    spent = spending(walk, time)
    assert set(LOSSES) <= set(spent)
    assert not any("_" in term for term in spent)  # they are written beside the bars
    assert sum(spent.values()) == pytest.approx(drawn(walk, time), abs=1e-9)
    assert spent["copper"] == walk.spent(time)["copper"]
