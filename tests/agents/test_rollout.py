"""Walks of a policy side by side, disturbed or not, and episodes of the single environment."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.conditions import Conditions
from agents.policy_files import BASELINES, named_policy
from agents.rollout import Interval, Rollout, controller_policy, draw_starts, episodes, measured
from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_PHYSICAL

PUSHES = {"pushes": {"rate": 5.0, "impulse": (0.2, 0.5)}}
NOISE = {"sensor_noise": {"leg_angle": 0.01, "pendulum_angle": 0.3, "leg_rate": 0.2}}


def roll(states: Any, observations: Any) -> Any:
    return np.clip(0.4 * observations[:, 3] - 0.6 * observations[:, 1], -1, 1).astype(float)


def intervals(policy: Any = roll, n: int = 40, disturbances: Any = None) -> list[Interval]:
    conditions = Conditions.of(THESIS_PHYSICAL, None, disturbances)
    return list(Rollout(conditions, policy, draw_starts(THESIS_PHYSICAL, 12, 1), n))


def after(walks: list[Interval]) -> Any:
    return np.concatenate([interval.after.ravel() for interval in walks])


@pytest.mark.parametrize("disturbances", [PUSHES, NOISE, {"actuator_delay": 3}])
def test_disturbances_change_a_walk_and_the_same_seed_repeats_it(disturbances: Any) -> None:
    rough = after(intervals(disturbances=disturbances))
    np.testing.assert_array_equal(rough, after(intervals(disturbances=disturbances)))
    calm = after(intervals())
    assert len(rough) != len(calm) or not np.array_equal(rough, calm)


def test_a_law_is_given_the_state_that_noisy_sensors_measure() -> None:
    seen: list[Any] = []

    def law(x: Any, mode: Any) -> Any:
        seen.append(x.copy())
        return np.zeros(len(x))

    policy = controller_policy(THESIS_PHYSICAL, law)
    for x, interval in zip(seen, intervals(policy, n=5), strict=False):
        np.testing.assert_array_equal(x, interval.states[:, :4])
    seen.clear()
    noisy = intervals(policy, n=5, disturbances=NOISE)
    assert len(seen) == len(noisy) == 5
    for x, interval in zip(seen, noisy, strict=True):
        errors = (x - interval.states[:, :4] + math.pi) % (2 * math.pi) - math.pi
        assert 0.05 < np.std(errors[:, 1]) < 1.0
        assert 0.05 < np.std(errors[:, 2]) < 1.0
        assert np.abs(errors[:, 3]).max() < 1e-5  # this rate is measured exactly


def test_without_noise_the_measured_state_is_exact_up_to_whole_turns() -> None:
    for interval in intervals():
        x = measured(interval.observations, THESIS_PHYSICAL.leg_angle)
        difference = x - interval.states[:, :4]
        difference[:, 1] -= 2 * math.pi * np.round(difference[:, 1] / (2 * math.pi))
        np.testing.assert_allclose(difference, 0.0, atol=1e-5)


def test_a_policy_that_writes_into_its_inputs_changes_nothing_but_its_action() -> None:
    def vandal(states: Any, observations: Any) -> Any:
        action = roll(states, observations)
        states[:] = np.nan
        observations[:] = np.nan
        return action

    starts = draw_starts(THESIS_PHYSICAL, 6, 1)
    original = starts.copy()
    walks = (Rollout(Conditions(THESIS_PHYSICAL), policy, starts, 40) for policy in (roll, vandal))
    for mine, theirs in zip(*walks, strict=True):
        for name in ("running", "states", "observations", "actions", "after"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), name)
        for name, values in mine.info.items():
            np.testing.assert_array_equal(values, theirs.info[name], name)
    np.testing.assert_array_equal(starts, original)


def test_a_walk_that_has_ended_does_not_stop_the_others() -> None:
    machine = THESIS_PHYSICAL.replace(impact_law="thesis")  # backward touchdowns are errors
    starts = draw_starts(machine, 40, 3)
    starts = starts[(starts[:, 0] > np.pi / 2) & (starts[:, 2] > 0.5)]
    walks = list(Rollout(Conditions(machine), lambda x, seen: np.ones(len(x)), starts, 40))
    assert 0 < len(walks[-1].running) < len(starts)


def no_gait(params: Any) -> Any:
    pytest.fail("no gait is needed")


class Counting:
    """A policy with a memory: its voltage grows with every decision of a walk."""

    def begin(self, machines, running):
        decisions = np.zeros(len(machines))

        def policy(states, observations):
            decisions[running()] += 1
            return 1e-3 * decisions[running()]

        return policy


def test_a_policy_remembers_during_an_episode() -> None:
    envs = Conditions(BUILDABLE).envs(2, max_episode_steps=20)
    for episode in episodes(envs, Counting(), 7):
        np.testing.assert_allclose(episode.actions[:, 0], 1e-3 * np.arange(1, 21), rtol=1e-6)


@pytest.mark.parametrize("name", ["random", "evolution"])
def test_the_single_environment_repeats_every_episode_bit_for_bit(name: str) -> None:
    policy = named_policy(name, no_gait).policy
    envs = Conditions(BUILDABLE).envs(3, max_episode_steps=120)
    alone = gym.make("RimlessWheel-v0", max_episode_steps=120)
    walked = episodes(envs, policy, 7, keep=("distance", "mode"))
    assert [episode.seed for episode in walked] == [7, 8, 9]
    for episode in walked:
        observation, info = alone.reset(seed=episode.seed)
        np.testing.assert_array_equal(observation, episode.observations[0])
        infos = [info]
        for k, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, info = alone.step(action)
            np.testing.assert_array_equal(observation, episode.observations[k + 1])
            assert reward == episode.rewards[k]
            ends = episode.terminations[k], episode.truncations[k]
            assert (terminated, truncated) == ends
            infos.append(info)
        assert terminated or truncated
        for entry, values in episode.infos.items():
            np.testing.assert_array_equal(values, [info[entry] for info in infos])


def test_rows_end_by_themselves() -> None:
    envs = Conditions(BUILDABLE).envs(12, max_episode_steps=300)
    walked = episodes(envs, BASELINES["random"](0))
    assert len({len(episode.rewards) for episode in walked}) > 2
    for episode in walked:
        assert not (episode.terminations | episode.truncations)[:-1].any()
        assert episode.terminations[-1] == (len(episode.rewards) < 300)
        assert episode.total == episode.rewards.sum()


def test_random_voltages_follow_the_seed_and_baselines_walk_on_any_machine() -> None:
    states = np.zeros((4, 5))
    first, again, other = (
        named_policy("random", no_gait, seed=seed).policy(states, states) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first, other).any()
    idle = named_policy("idle", no_gait, PROTOTYPE)
    assert idle.params == PROTOTYPE
    assert not idle.policy(states, states).any()
