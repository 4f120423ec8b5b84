from __future__ import annotations

import functools

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.evolution.policy import SIZE, act
from agents.evolution.walks import Duration, Walks, World
from agents.evolution.worth import members
from agents.policies import learned_policy
from agents.rollout import Rollout, draw_starts
from rimless_gym import BUILDABLE
from rimless_gym.kernel.stepping import THETA

DURATION = Duration(300, 100)


@pytest.fixture(scope="module")
def weights():
    rng = np.random.default_rng(0)
    some = 0.3 * rng.normal(size=(5, SIZE))
    some[0] = 0.0
    some[0, 0] = 0.6
    return some


@pytest.fixture(scope="module")
def starts():
    return draw_starts(BUILDABLE, 6, 3)


@pytest.fixture(scope="module")
def walks(weights, starts):
    return World(BUILDABLE).walk(weights, starts, DURATION)


def test_walks_are_those_of_the_environment(weights, starts, walks):
    for p in range(len(weights)):
        policy = learned_policy(functools.partial(act, weights[p]))
        distance, energy, lasted = np.zeros(6), np.zeros(6), np.zeros(6)
        steps, turned = np.zeros(6), np.zeros(6)
        rollout = Rollout(Conditions(BUILDABLE), policy, starts, DURATION.intervals, seed=0)
        for t, interval in enumerate(rollout):
            alive = interval.info["failure"] == 0
            i = interval.running[alive]
            lasted[i] += 1 / DURATION.intervals
            if t >= DURATION.intervals - DURATION.window:
                distance[i] += interval.info["distance"][alive]
                energy[i] += interval.info["electrical_positive"][alive]
                steps[i] += interval.info["steps"][alive]
                turned[i] += (interval.after - interval.states)[alive, THETA]
        assert walks.lasted[p] == pytest.approx(lasted)
        whole = lasted > 0.999
        assert walks.distance[p][whole] == pytest.approx(distance[whole], abs=2e-4)
        assert walks.energy[p][whole] == pytest.approx(energy[whole], rel=1e-3, abs=1e-3)
        assert np.array_equal(walks.steps[p][whole], steps[whole])
        assert walks.turned[p][whole] == pytest.approx(turned[whole], abs=1e-3)


def test_a_walk_depends_neither_on_threads_nor_on_the_others(weights, starts, walks):
    alone = World(BUILDABLE, threads=1).walk(weights[2:3], starts[4:5], DURATION)
    for one, all_of_them in zip(alone, walks, strict=True):
        assert one[0, 0] == all_of_them[2, 4]


def test_under_a_steady_voltage_the_pendulum_leans_forward_and_the_wheel_rolls(weights):
    starts = draw_starts(BUILDABLE, 12, 3)
    found = World(BUILDABLE).walk(weights[:1], starts, Duration(1000, 500))
    rolls = members(found, 0.0)
    assert rolls.any()
    assert found.distance[rolls].min() > 1.5


def test_an_action_is_within_its_limits_and_smooth():
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(2000, 6)).astype(np.float32)
    actions = act(3.0 * rng.normal(size=SIZE), seen)
    assert np.abs(actions).max() == 1.0
    line = np.zeros((1000, 6), np.float32)
    angle = np.linspace(0.0, 2 * np.pi, 1000)
    line[:, 1], line[:, 2], line[:, 4] = np.sin(angle), np.cos(angle), np.sin(2 * angle)
    assert np.abs(np.diff(act(0.3 * rng.normal(size=SIZE), line))).max() < 0.05


def test_the_fields_are_those_of_the_compiled_results(walks):
    assert isinstance(walks, Walks)
    assert all(field.shape == (5, 6) for field in walks)
    assert (walks.slipping <= DURATION.window).all()
