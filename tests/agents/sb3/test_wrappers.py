"""The environments that stable-baselines3's algorithms train in, and the wrappers around them."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor

from agents.conditions import Conditions
from agents.rollout import draw_starts
from agents.sb3.feedforward import BackEmfFeedforward, Feedforward
from agents.sb3.vec_env import Sb3VecEnv
from agents.sb3.wrappers import HeldActions, ScaledRewards, training_env
from rimless_gym import BUILDABLE, THESIS_PHYSICAL, Task, hybrid
from rimless_gym.envs.layout import observe

N = 16


def made(*wrappers, n=N, seed=7, episode_steps=None):
    return training_env(n, Conditions(), Task(), seed, wrappers, episode_steps)


def holding(intervals, n, seed):
    return made((HeldActions, {"intervals": intervals}), n=n, seed=seed)


@pytest.mark.parametrize("voltage", [0.0, 1.0])
def test_the_learner_gets_an_episodes_last_observation_and_the_reason_for_its_end(voltage):
    # At rest time runs out, and under full voltage the wheel falls: compared with the plain
    # environment, which no vector environment resets.
    vector = training_env(2, Conditions(THESIS_PHYSICAL), Task(), 4, episode_steps=200)
    alone = [
        gym.make("RimlessWheel-v0", params=THESIS_PHYSICAL, task=Task(), max_episode_steps=200)
        for _ in range(2)
    ]
    first = np.array([env.reset(seed=4 + i)[0] for i, env in enumerate(alone)])
    np.testing.assert_array_equal(vector.reset(), first)
    running, reasons = {0, 1}, []
    while running:
        seen, _, dones, infos = vector.step(np.full((2, 1), voltage, dtype=np.float32))
        for i in sorted(running):
            last, _, terminated, truncated, _ = alone[i].step(np.array([voltage], np.float32))
            assert dones[i] == (terminated or truncated)
            assert infos[i]["TimeLimit.truncated"] == (truncated and not terminated)
            if not dones[i]:
                np.testing.assert_array_equal(seen[i], last)
                continue
            np.testing.assert_array_equal(infos[i]["terminal_observation"], last)
            np.testing.assert_array_equal(seen[i], alone[i].reset()[0])
            reasons.append("time" if truncated else "fall")
            running.remove(i)
    assert ("fall" if voltage else "time") in reasons


def test_a_held_action_is_that_of_several_control_intervals_and_their_rewards_are_summed():
    held, plain = (holding(k, 8, 6) for k in (4, 1))
    np.testing.assert_array_equal(held.reset(), plain.reset())
    action, ends = np.ones((8, 1), dtype=np.float32), 0
    for _ in range(60):
        seen, total, dones, infos = held.step(action)
        summed, over, last = np.zeros(8), np.zeros(8, dtype=bool), [{} for _ in range(8)]
        for _ in range(4):
            latest_seen, rewards, ended, latest = plain.step(action)
            summed += np.where(over, 0.0, rewards)
            for i in (ended & ~over).nonzero()[0]:
                last[i] = latest[i]
            over |= ended
        np.testing.assert_array_equal(seen, latest_seen)
        np.testing.assert_array_equal(dones, over)
        np.testing.assert_allclose(total, summed, atol=1e-6)
        for i in over.nonzero()[0]:
            ends += 1
            np.testing.assert_array_equal(
                infos[i]["terminal_observation"], last[i]["terminal_observation"]
            )
    assert ends > 3


def test_a_monitor_below_counts_control_intervals_and_one_above_decisions():
    def envs():
        env = Sb3VecEnv(gym.make_vec("RimlessWheel-v0", num_envs=8, autoreset_mode="SameStep"))
        env.seed(6)
        return env

    below, above = HeldActions(VecMonitor(envs()), 4), VecMonitor(HeldActions(envs(), 4))
    below.reset(), above.reset()
    action, first = np.ones((8, 1), dtype=np.float32), [False] * 8
    for _ in range(60):
        (*_, dones, inside), (*_, outside) = below.step(action), above.step(action)
        for i in (dones & ~np.array(first)).nonzero()[0]:
            first[i] = True  # later episodes begin with rewards that only the monitor below sees
            exact, seen = inside[i]["episode"], outside[i]["episode"]
            assert exact["r"] == pytest.approx(seen["r"], rel=1e-5)
            assert seen["l"] == -(-exact["l"] // 4)
    assert sum(first) > 3


def test_no_current_flows_at_the_back_emf():
    states, p = draw_starts(BUILDABLE, 16, 3), BUILDABLE.constants
    seen = observe(BUILDABLE, states)
    shares = Feedforward(BUILDABLE, 1.0).voltages(np.zeros((16, 1)), seen)[:, 0]
    volts = BUILDABLE.voltage_limit * shares
    rates = hybrid.relative_rate(states[:, 2], states[:, 3], p)
    assert np.abs(volts).max() > 0.2
    stalled = hybrid.motor_current(0.0, BUILDABLE.voltage_limit, p)
    np.testing.assert_allclose(hybrid.motor_current(rates, volts, p) / stalled, 0.0, atol=1e-6)


def test_with_feedforward_actions_are_deviations_from_the_back_emf_of_what_is_seen():
    fed, plain = made((BackEmfFeedforward, {"scale": 0.3})), made()
    seen, rng = fed.reset(), np.random.default_rng(1)
    np.testing.assert_array_equal(seen, plain.reset())
    for _ in range(30):
        actions = rng.uniform(-1.0, 1.0, (N, 1)).astype(np.float32)
        volts = Feedforward(BUILDABLE, 0.3).voltages(actions, seen)
        seen = fed.step(actions)[0]
        np.testing.assert_array_equal(seen, plain.step(volts)[0])


def test_rewards_are_scaled():
    scaled, plain = made((ScaledRewards, {"scale": 40.0})), made()
    np.testing.assert_array_equal(scaled.reset(), plain.reset())
    actions = np.ones((N, 1), np.float32)
    for _ in range(20):
        np.testing.assert_allclose(scaled.step(actions)[1], 40.0 * plain.step(actions)[1])
