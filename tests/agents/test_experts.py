"""One expert for many commanded speeds, and the gait and start-up of a policy."""

from types import SimpleNamespace

import numpy as np
import pytest

from agents import experts
from agents.conditions import Conditions
from agents.experts import (
    FAR,
    GainSchedule,
    OwnLaws,
    ScheduledLaw,
    gain_schedule,
    walked_gait,
    with_startup,
)
from agents.learner import DoesNotWalkError
from agents.policy_files import load_policy
from agents.rollout import Rollout, at_rest, draw_starts
from rimless_gym import BUILDABLE
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.kernel.stepping import MODE
from trajopt.feedback.controller import NEAR
from trajopt.feedback.law import Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Orbit, squared_distances

STATE = np.array([[1.5, 0.0, -2.0, 0.0, SINGLE, 0.0]])


def law(speed, value, offset=100.0):
    """A law that does `value`; its short orbit lies `offset` of pendulum rate away from STATE."""
    nodes = np.repeat(STATE[:, :4], 64, axis=0) + [0.0, 0.0, 0.0, offset]
    nodes[:, 1] += np.linspace(-1e-3, 1e-3, 64)
    continued = np.arange(64) < 63
    orbit = Orbit(nodes, np.arange(64.0), np.zeros(64), continued, np.ones(4), 12.0)
    return ScheduledLaw(speed, lambda states, observations: np.full(len(states), value), orbit)


def commanded(*speeds):
    observations = np.zeros((len(speeds), 8), dtype=np.float32)
    observations[:, 6] = (np.array(speeds) - 0.45) / 0.2
    return observations


def test_far_from_all_gaits_the_fastest_law_acts_whatever_the_command():
    schedule = GainSchedule((law(0.4, 0.1), law(0.5, 0.2), law(0.6, 0.3)))
    actions = schedule(np.repeat(STATE, 5, axis=0), commanded(0.3, 0.44, 0.46, 0.56, 0.9))
    np.testing.assert_array_equal(actions, [0.3] * 5)


def test_near_the_gaits_the_law_nearest_to_the_command_acts_among_those_within_reach():
    away = {3: 0.05, 4: 0.0, 5: 0.05, 6: 0.1}
    laws = [law(0.1 * k, 0.1 * k, offset=away.get(k, 100.0)) for k in range(1, 8)]
    actions = GainSchedule(tuple(laws))(
        np.repeat(STATE, 5, axis=0), commanded(0.1, 0.3, 0.4, 0.6, 0.7)
    )
    np.testing.assert_allclose(actions, [0.3, 0.3, 0.4, 0.5, 0.5])


def test_near_a_gait_and_with_none_within_reach_the_law_of_the_nearest_gait_acts():
    schedule = GainSchedule((law(0.4, 0.4, offset=0.12), law(0.5, 0.5, offset=0.1), law(0.6, 0.6)))
    np.testing.assert_allclose(schedule(STATE, commanded(0.4)), [0.5])


def test_at_rest_on_two_feet_nothing_is_on_a_gait():
    resting = STATE.copy()
    resting[:, MODE] = DOUBLE
    schedule = GainSchedule(
        (law(0.3, 0.3, offset=0.0), *(law(0.1 * k, 0.1 * k) for k in (4, 5, 6)))
    )
    np.testing.assert_allclose(schedule(resting, commanded(0.3)), [0.6])
    np.testing.assert_allclose(schedule(STATE, commanded(0.6)), [0.3])


@pytest.mark.slow
def test_the_laws_of_a_gain_schedule_walk_at_the_commanded_speed(tmp_path):
    """One whose step lasts whole control periods, and one of half a period less."""
    conditions = Conditions.of(BUILDABLE, None, None, (0.56, 0.573), 0.01)
    schedule = gain_schedule("lqr", conditions, tmp_path)
    assert BUILDABLE.step_length / (0.005 * schedule.speeds) == pytest.approx([92, 91])
    starts = draw_starts(BUILDABLE, 6, 0)
    for speed in schedule.speeds:
        distance = np.zeros(6)
        for k, interval in enumerate(Rollout(conditions, schedule, starts, 2000, command=speed)):
            if k >= 1000:
                distance[interval.running] += interval.info["distance"]
        assert distance.mean() / 10.0 == pytest.approx(speed, rel=0.005)


def test_a_machines_own_law_acts_from_as_far_away_as_its_gait_is_from_the_nominal_one():
    nominal = SimpleNamespace(duration=1.0, state=lambda times: np.repeat(STATE[:, :4], 10, axis=0))
    own = Law(BUILDABLE, lqr.volts, law(0.56, 0.0, offset=0.1))
    controller = SimpleNamespace(
        table=SimpleNamespace(gait=nominal, has=lambda slope: True),
        law_of=lambda machine: own,
        with_startup=lambda law: law.reach,
        near=0.05,
    )
    assert OwnLaws(controller).controller_for(BUILDABLE) == pytest.approx(
        1.0 + 0.1 / 0.05, rel=1e-3
    )


@pytest.fixture
def briefly(monkeypatch):
    """The gait of policies is that of walks of 15 s, from 8 starts."""
    monkeypatch.setattr(experts, "LONG", 15.0)
    monkeypatch.setattr(experts, "RECORDED_STARTS", 8)


def test_a_policys_own_gait_is_the_one_that_it_walks_at_last(briefly):
    policy = load_policy("imitation")
    orbit, weights = walked_gait(policy.policy, policy.conditions)
    walk = Rollout(policy.conditions, policy.policy, draw_starts(BUILDABLE, 4, 9), 1500)
    gait = np.concatenate([each.states for each in list(walk)[-300:]])
    states = np.ascontiguousarray(gait[gait[:, MODE] == SINGLE, :4])
    assert squared_distances(states, orbit).max() < NEAR**2
    assert not orbit.continued[-1]  # or the search would go on beyond the table
    assert squared_distances(at_rest(BUILDABLE)[None, :4], orbit)[0] > 1.0
    # of the clone's cost of transport, 0.044, and speed, 0.62 m/s
    assert weights.time == pytest.approx((0.5 - 0.044) * 0.62, rel=0.01)
    assert weights.energy == pytest.approx(1.0 / BUILDABLE.weight)


def test_near_its_gait_a_policy_acts_and_elsewhere_its_start_up_controller(briefly, monkeypatch):
    policy = load_policy("imitation")
    monkeypatch.setattr(experts, "startup_for", lambda *args: lambda x, mode: 6.0 + 0.0 * x[:, 0])
    blended = with_startup(policy.policy, policy.conditions, progress=False)
    walk = list(Rollout(policy.conditions, policy.policy, at_rest(BUILDABLE)[None], 1500))
    states, observations, own = (
        np.concatenate([getattr(each, name) for each in walk])
        for name in ("states", "observations", "actions")
    )
    orbit, _ = walked_gait(policy.policy, policy.conditions)
    away = np.sqrt(squared_distances(np.ascontiguousarray(states[:, :4]), orbit))
    away[states[:, MODE] != SINGLE] = np.inf
    share = np.clip((away - NEAR) / (FAR - NEAR), 0.0, 1.0)
    assert {0.0, 1.0} < set(share)
    assert ((share > 0.1) & (share < 0.9)).any()
    expected = own + share * (6.0 / BUILDABLE.voltage_limit - own)
    np.testing.assert_allclose(blended(states, observations), expected, atol=1e-6)


def test_a_policy_that_does_not_walk_has_no_gait_to_start_up_to(briefly):
    idle = lambda states, observations: np.zeros(len(states))  # noqa: E731
    with pytest.raises(DoesNotWalkError, match="still walks after 15 s from none of 8 starts"):
        with_startup(idle, Conditions(BUILDABLE), progress=False)
