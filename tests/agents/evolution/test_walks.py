from __future__ import annotations

import functools

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.evolution.walks import (
    SIZE,
    Duration,
    PolicySimulator,
    PolicyWalks,
    WalkReward,
    act,
    families,
    members,
    senses,
)
from agents.reward_weight import NO_WALK
from agents.rollout import Rollout, draw_starts, learned_policy
from rimless_gym import BUILDABLE, Task
from rimless_gym.kernel.stepping import THETA

DURATION = Duration(200, 80)


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
def simulated(weights, starts):
    return PolicySimulator(BUILDABLE).walk(weights, starts, DURATION)


def test_walks_are_those_of_the_environment(weights, starts, simulated):
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
        assert simulated.lasted[p] == pytest.approx(lasted)
        whole = lasted > 0.999
        assert simulated.distance[p][whole] == pytest.approx(distance[whole], abs=2e-4)
        assert simulated.energy[p][whole] == pytest.approx(energy[whole], rel=1e-3, abs=1e-3)
        assert np.array_equal(simulated.steps[p][whole], steps[whole])
        assert simulated.turned[p][whole] == pytest.approx(turned[whole], abs=1e-3)


def test_a_walk_depends_neither_on_threads_nor_on_the_others(weights, starts, simulated):
    alone = PolicySimulator(BUILDABLE, threads=1).walk(weights[2:3], starts[4:5], DURATION)
    for one, all_of_them in zip(alone, simulated, strict=True):
        assert one[0, 0] == all_of_them[2, 4]


def test_an_action_is_within_its_limits_and_smooth():
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(2000, 6)).astype(np.float32)
    actions = act(3.0 * rng.normal(size=SIZE), seen)
    assert np.abs(actions).max() == 1.0
    line = np.zeros((1000, 6), np.float32)
    angle = np.linspace(0.0, 2 * np.pi, 1000)
    line[:, 1], line[:, 2], line[:, 4] = np.sin(angle), np.cos(angle), np.sin(2 * angle)
    assert np.abs(np.diff(act(0.3 * rng.normal(size=SIZE), line))).max() < 0.05


LONG = Duration(1000, 500)
STEP = 2 * BUILDABLE.leg_length * np.sin(np.pi / BUILDABLE.n_legs)


def walks(**changes):
    """One policy from two starts, whirling forward once a step at 0.52 m/s for 10 s."""
    values = {
        "lasted": 1.0,
        "distance": 10 * STEP,
        "energy": 2.5,
        "steps": 10.0,
        "turned": -20 * np.pi,
        "slipping": 0.0,
    } | changes
    return PolicyWalks(**{name: np.full((1, 2), value) for name, value in values.items()})


@pytest.fixture
def objective():
    return WalkReward(BUILDABLE, Task(), speed=0.62)


def score(objective, family=-1, weight=1.0, **changes):
    return objective.scores(walks(**changes), LONG, family, weight)[0]


def test_the_reward_of_a_walk_is_its_distance_less_its_energy(objective):
    energy = (2.5 + 5.0 * BUILDABLE.idle_power) / BUILDABLE.weight
    assert score(objective) == pytest.approx((10 * STEP - energy) / 5.0)


def test_distance_above_the_rewarded_speed_is_not_rewarded(objective):
    assert score(objective, distance=3.1) == pytest.approx(score(objective, distance=7.0))


def test_distance_in_another_familys_gait_is_not_rewarded(objective):
    energy = (2.5 + 5.0 * BUILDABLE.idle_power) / BUILDABLE.weight
    assert score(objective, family=0) == pytest.approx(-energy / 5.0)


def test_falls_and_slips_have_the_penalties_of_the_task(objective):
    task = Task()
    assert score(objective) - score(objective, slipping=5.0) == pytest.approx(
        task.slip_penalty * 0.05 / 5.0
    )
    late, early = (score(objective) - score(objective, lasted=lasted) for lasted in (0.999, 0.5))
    assert late == pytest.approx(1.001 * task.fall_penalty / 5.0)
    assert early == pytest.approx(1.5 * task.fall_penalty / 5.0)


def test_only_the_best_starts_count(objective):
    one_falls = walks()
    one_falls.lasted[0, 1] = 0.2
    scores_by = [
        objective.scores(one_falls, LONG, -1, 1.0, counted)[0] for counted in (0.1, 0.5, 1.0)
    ]
    assert scores_by[0] == scores_by[1] == pytest.approx(score(objective))
    assert scores_by[2] < 0.7 * scores_by[0]


def test_a_pendulum_that_hardly_turns_has_no_sense():
    several = walks()
    assert senses(several).tolist() == [[-1, -1]]
    several.turned[0] = 4.0, 3.0
    assert senses(several).tolist() == [[1, 0]]
    several.lasted[0, 0] = 0.9
    assert senses(several).tolist() == [[0, 0]]


def test_a_gait_is_that_of_the_walks_by_the_rules_in_its_family(objective):
    gait = objective.gait(walks(), LONG, -1)
    energy = 2.5 + 5.0 * BUILDABLE.idle_power
    assert gait.share == 1.0
    assert gait.speed == pytest.approx(10 * STEP / 5.0)
    assert gait.cot == pytest.approx(energy / (BUILDABLE.weight * 10 * STEP))
    assert objective.gait(walks(), LONG, 0) == NO_WALK
    assert objective.gait(walks(slipping=1.0), LONG, -1) == NO_WALK
    assert objective.gait(walks(lasted=0.9), LONG, -1) == NO_WALK


def test_families_are_whole_revolutions_per_step_fewest_first():
    several = PolicyWalks(
        *(
            np.concatenate([a, b, c])
            for a, b, c in zip(walks(), walks(turned=0.3), walks(turned=-30 * np.pi), strict=True)
        )
    )
    assert families(several).tolist() == [0, -1]  # one and a half belong to no family
    assert members(several, -1).all(axis=1).tolist() == [True, False, False]
    assert families(walks(steps=2.0)).tolist() == []
