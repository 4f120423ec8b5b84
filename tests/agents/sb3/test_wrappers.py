"""The environments that stable-baselines3's algorithms train in, and the wrappers around them."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor

from agents.conditions import Conditions
from agents.sb3.vec_env import Sb3VecEnv
from agents.sb3.wrappers import (
    HeldActions,
    ScaledReward,
    StartUpPhase,
    begin_out_of_step,
    training_env,
    wrapped,
)
from rimless_gym import THESIS_PHYSICAL, Task
from rimless_gym.envs.task import TERM_NAMES

N, START_UP = 16, 5


def made(*wrappers, n=N, seed=7, episode_steps=None):
    return training_env(n, Conditions(), Task(), seed, wrappers, episode_steps)


def holding(intervals, n, seed):
    return made((HeldActions, {"intervals": intervals}), n=n, seed=seed)


def test_rewards_are_scaled_for_the_learner_only():
    plain, scaled = (made((ScaledReward, {"scale": scale}), n=1) for scale in (1.0, 100.0))
    for env in (plain, scaled):
        env.reset()
    action = np.full((1, 1), 0.7, dtype=np.float32)
    (_, small, *_), (_, large, *_) = plain.step(action), scaled.step(action)
    assert large[0] == pytest.approx(100 * small[0])
    assert small[0] == pytest.approx(
        sum(wrapped(plain, Sb3VecEnv).last_info[name][0] for name in TERM_NAMES)
    )


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


@pytest.mark.parametrize("travel", [0.0, 0.2])
def test_at_first_energy_is_free_and_travel_counts_less_but_falls_and_slips_do_not(travel):
    free = made((StartUpPhase, {"intervals": START_UP, "travel": travel}))
    plain = made()
    np.testing.assert_array_equal(free.reset(), plain.reset())
    ages, seen = np.zeros(N, dtype=int), set()
    rng = np.random.default_rng(0)
    for _ in range(150):
        actions = rng.choice([-1.0, 1.0], size=(N, 1)).astype(np.float32)
        (_, rewards, dones, _), (_, whole, _, _) = free.step(actions), plain.step(actions)
        info = wrapped(free, Sb3VecEnv).last_info
        for i in range(N):
            penalties = info["reward_slip"][i] + info["reward_end"][i]
            early = ages[i] < START_UP
            expected = travel * info["reward_distance"][i] + penalties if early else whole[i]
            assert rewards[i] == pytest.approx(expected, abs=1e-7)
            seen.add((bool(early), penalties < 0.0))
        ages = np.where(dones, 0, ages + 1)
    assert len(seen) == 4


def backward(env):
    info = wrapped(env, Sb3VecEnv).last_info
    return (info["touchdowns"] - info["steps"]) / 2


def test_each_step_backward_has_a_penalty_once_the_start_up_is_over():
    phases = [(StartUpPhase, {"intervals": 40, "penalty": penalty}) for penalty in (0.3, 0.0)]
    penalised, plain = map(made, phases)
    for env in (penalised, plain):
        env.reset()
    rng, counted = np.random.default_rng(0), np.zeros(2)
    for _ in range(150):
        actions = rng.choice([-1.0, 1.0], size=(N, 1)).astype(np.float32)
        walking = ~wrapped(penalised, StartUpPhase).starting
        _, rewards, _, _ = penalised.step(actions)
        less, back = plain.step(actions)[1] - rewards, backward(penalised)
        info = wrapped(penalised, Sb3VecEnv).last_info
        for touchdowns, forward, steps in zip(info["touchdowns"], info["steps"], back, strict=True):
            if (touchdowns, forward) in ((0, 0), (1, 1), (2, 2)):
                assert steps == 0
            if (touchdowns, forward) == (1, -1):
                assert steps == 1
        np.testing.assert_allclose(less, 0.3 * walking * back, atol=1e-6)
        counted += back[walking].sum(), back[~walking].sum()
    assert (counted > 0).all()


def test_the_penalty_may_change_and_what_is_monitored_has_none():
    env = made((StartUpPhase, {}), episode_steps=20)
    env.reset()
    wrapped(env, StartUpPhase).penalty = 0.5
    rng = np.random.default_rng(1)
    rewarded, ended, back = np.zeros(N), {}, np.zeros(N)
    for _ in range(20):
        actions = rng.choice([-1.0, 1.0], size=(N, 1)).astype(np.float32)
        _, rewards, dones, infos = env.step(actions)
        for i in set(range(N)) - set(ended):
            rewarded[i] += rewards[i]
            back[i] += backward(env)[i]
            if dones[i]:
                ended[i] = infos[i]["episode"]["r"]
    assert back.max() > 0
    np.testing.assert_allclose([ended[i] for i in range(N)], rewarded + 0.5 * back, atol=1e-4)


def test_rows_that_begin_out_of_step_are_of_all_ages():
    env = made((StartUpPhase, {"intervals": START_UP}), n=40, episode_steps=20)
    seen = begin_out_of_step(env, lambda observations: np.zeros(len(observations)))
    assert seen.shape == (40, 6)
    ages = wrapped(env, StartUpPhase).monitor.episode_lengths.copy()
    assert np.bincount(ages, minlength=20).tolist() == [2] * 20
    for k in range(20):  # each ends when its own time is over
        _, _, dones, infos = env.step(np.zeros((40, 1), dtype=np.float32))
        np.testing.assert_array_equal(dones, ages == 19 - k)
        assert all(infos[i]["TimeLimit.truncated"] for i in np.flatnonzero(dones))


@pytest.mark.parametrize(
    ("wrapper", "arguments", "error", "message"),
    [
        (HeldActions, {"intervals": 2.5}, TypeError, r"intervals = 2\.5: must be"),
        (HeldActions, {"intervals": 0}, ValueError, "intervals = 0"),
        (ScaledReward, {"scale": 0.0}, ValueError, r"scale = 0\.0: must be"),
        (StartUpPhase, {"penalty": -0.1}, ValueError, r"penalty = -0\.1"),
    ],
)
def test_arguments_of_wrappers_are_checked(wrapper, arguments, error, message):
    with pytest.raises(error, match=message):
        made((wrapper, arguments), n=1)
