"""Walks that are kept whole."""

import itertools

import numpy as np
import pytest

from agents.policy_files import named_policy
from agents.recording import STEPS, record, record_gait, record_policy
from agents.rollout import Rollout, at_rest
from rimless_gym import BUILDABLE
from rimless_gym.equations import DOUBLE
from rimless_gym.kernel.stepping import FOOT, PHI
from trajopt import periodic_gait


@pytest.fixture(scope="module")
def someone():
    return walker("evolution", None)


@pytest.fixture(scope="module")
def intervals(someone):
    return list(Rollout(someone.conditions, someone.policy, at_rest(BUILDABLE)[None], 600))


@pytest.fixture(scope="module")
def walk(intervals):
    return record("evolution", intervals, BUILDABLE, 0.01)


@pytest.fixture(scope="module")
def gait():
    return periodic_gait(BUILDABLE, 0.56, 1, hold=0.01)


def test_the_wheel_is_where_it_was(walk, intervals):
    for k in (0, 1, 317, 599):
        for time in (0.01 * k, 0.01 * k + 0.009):
            scene, state = walk.pose(time), intervals[k].states[0]
            assert scene.phi == state[PHI]
            assert scene.foot_x == state[FOOT] * BUILDABLE.step_length
            assert scene.voltage == 12.0 * intervals[k].actions[0]
    assert walk.pose(0.0).mode == DOUBLE
    assert walk.pose(99.0).phi == intervals[-1].after[0, PHI]  # it stays where it ended


def test_what_was_spent_is_the_sum_of_info(walk, intervals):
    for name in ("electrical", "copper", "friction", "gear", "collision", "idle", "distance"):
        told = sum(float(each.info[name][0]) for each in intervals[:250])
        assert walk.spent(2.5)[name] == pytest.approx(told, abs=1e-12)


def test_there_are_no_figures_before_some_steps_in_a_row(walk):
    first = walk.measured_from
    steps = [end for end in walk.touchdowns if end.time <= first.time][-STEPS - 1 :]
    assert len(steps) == STEPS + 1
    assert all(after.foot == before.foot + 1 for before, after in itertools.pairwise(steps))
    assert first.time > 2.0
    for time in np.arange(0.0, first.time, 0.1):
        assert walk.figures(time) is None
        assert walk.scene(time).cot is None
    assert walk.figures(first.time) is not None


def test_the_figures_are_those_of_the_last_steps(walk):
    ends = [end.time for end in walk.touchdowns if end.time <= 5.0][-STEPS - 1 :]
    figures = walk.figures(5.0)
    taken = ends[-1] - ends[0]
    before, after = (walk.spent(round(time, 2)) for time in (ends[0], ends[-1]))
    of = {name: after[name] - before[name] for name in before}
    assert figures.speed == pytest.approx(STEPS * BUILDABLE.step_length / taken, rel=1e-2)
    energy = of["electrical_positive"] + of["idle"]
    assert figures.cot == pytest.approx(energy / (BUILDABLE.weight * of["distance"]), rel=5e-2)


def test_a_wheel_that_stands_has_no_figures(someone):
    def rest(states, observations):
        return np.zeros(len(states))

    walks = Rollout(someone.conditions, rest, at_rest(BUILDABLE)[None], 50)
    standing = record("rest", walks, BUILDABLE, 0.01)
    assert standing.measured_from is None
    assert standing.scene(0.4).speed is None


def test_figures_vanish_when_the_wheel_stops(walk):
    assert walk.figures(walk.touchdowns[-1].time + 1.9) is not None
    assert walk.figures(walk.touchdowns[-1].time + 2.1) is None


def test_a_policy_from_rest_is_recorded_as_it_walks(someone, walk):
    own = record_walker(someone, 1.0)
    assert np.array_equal(own.states, walk.states[:101])
    assert (own.name, own.begins, own.ends) == ("evolution", 0.0, pytest.approx(1.0))


def test_the_shortest_walk_is_one_interval(someone):
    assert len(record_walker(someone, 0.001).volts) == 1


def test_a_gait_is_where_its_solution_says(gait):
    begins, legs = 0.437, 3
    ghost = record_gait("optimum", gait, 4.0, begins, legs)
    assert ghost.begins == pytest.approx(0.44)
    for time in (0.44, 0.5, 1.03, 3.99):
        scene, state = ghost.pose(time), gait.state(time - begins)
        assert (scene.phi, scene.theta) == pytest.approx(tuple(state[:2]), abs=1e-9)
        steps = int((time - begins) / gait.duration)
        assert scene.foot_x == pytest.approx((legs + steps) * BUILDABLE.step_length)
    hubs = [ghost.pose(time).hub(BUILDABLE)[0] for time in np.arange(0.44, 4.0, 0.01)]
    assert (np.diff(hubs) > 0.0).all()


def test_a_gait_costs_what_its_verification_says(gait):
    figures = record_gait("optimum", gait, 5.0).figures(4.9)
    assert figures.speed == pytest.approx(gait.speed, rel=1e-3)
    assert figures.cot == pytest.approx(gait.cot, rel=1e-3)


def test_the_foot_of_a_gait_moves_at_its_touchdowns(gait):
    times = np.array([0.0, 0.5, 0.999, 1.001, 2.5]) * gait.duration
    assert gait.foot(times).tolist() == [0, 0, 0, 1, 2]
    assert gait.foot(1.5 * gait.duration) == 1
