"""The environments that stable-baselines3's algorithms train in."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor

from agents.conditions import Conditions
from agents.sb3.training_env import HeldActions, Offer, ScaledReward, training_env
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym import THESIS_PHYSICAL, Task
from rimless_gym.envs.task import TERM_NAMES
from tests.agents.sb3_rows import ID


def holding(intervals):
    return Offer({HeldActions: {"intervals": intervals}})


def test_rewards_are_scaled_for_the_learner_only():
    plain, scaled = (
        training_env(1, Conditions(), Task(), 3, Offer({ScaledReward: {"scale": scale}}))
        for scale in (1.0, 100.0)
    )
    for env in (plain, scaled):
        env.reset()
    action = np.full((1, 1), 0.7, dtype=np.float32)
    (_, small, _, infos), (_, large, _, _) = plain.step(action), scaled.step(action)
    assert large[0] == pytest.approx(100 * small[0])
    assert small[0] == pytest.approx(sum(infos[0][name] for name in TERM_NAMES))


@pytest.mark.parametrize(
    ("layers", "error", "message"),
    [
        ({HeldActions: {"intervals": 2.5}}, TypeError, r"intervals = 2\.5: must be"),
        ({HeldActions: {"intervals": 0}}, ValueError, "intervals = 0"),
        ({ScaledReward: {"scale": 0.0}}, ValueError, r"scale = 0\.0: must be"),
    ],
)
def test_arguments_of_layers_are_checked_when_environments_are_made(layers, error, message):
    with pytest.raises(error, match=message):
        training_env(1, Conditions(), Task(), 3, Offer(layers))


@pytest.mark.parametrize("voltage", [0.0, 1.0])
def test_the_learner_gets_an_episodes_last_observation_and_the_reason_for_its_end(voltage):
    # At rest time runs out, and under full voltage the wheel falls: compared with the plain
    # environment, which no vector environment resets.
    vector = training_env(3, Conditions(THESIS_PHYSICAL), Task(), 4)
    alone = [gym.make("RimlessWheel-v0", params=THESIS_PHYSICAL, task=Task()) for _ in range(3)]
    first = np.array([env.reset(seed=4 + i)[0] for i, env in enumerate(alone)])
    np.testing.assert_array_equal(vector.reset(), first)
    running, reasons = {0, 1, 2}, []
    while running:
        seen, _, dones, infos = vector.step(np.full((3, 1), voltage, dtype=np.float32))
        for i in sorted(running):
            last, _, terminated, truncated, _ = alone[i].step(np.array([voltage], np.float32))
            assert dones[i] == (terminated or truncated)
            assert infos[i]["TimeLimit.truncated"] == (truncated and not terminated)
            if not dones[i]:
                np.testing.assert_array_equal(seen[i], last)
                continue
            np.testing.assert_array_equal(infos[i]["terminal_observation"], last)
            np.testing.assert_array_equal(seen[i], alone[i].reset()[0])
            assert not np.array_equal(seen[i], last)
            reasons.append("time" if truncated else "fall")
            running.remove(i)
    assert ("fall" if voltage else "time") in reasons


def test_a_held_action_is_that_of_several_control_intervals_and_their_rewards_are_summed():
    held, plain = (training_env(3, Conditions(), Task(), 5, holding(k)) for k in (4, 1))
    np.testing.assert_array_equal(held.reset(), plain.reset())
    action = np.full((3, 1), 0.4, dtype=np.float32)
    seen, total, _, _ = held.step(action)
    steps = [plain.step(action) for _ in range(4)]
    np.testing.assert_array_equal(seen, steps[-1][0])
    np.testing.assert_allclose(total, sum(step[1] for step in steps), rtol=1e-6)


def test_an_episode_that_ends_while_an_action_is_held_is_reported_as_it_ended():
    held, plain = (training_env(8, Conditions(), Task(), 6, holding(k)) for k in (4, 1))
    held.reset(), plain.reset()
    action, ends = np.ones((8, 1), dtype=np.float32), 0
    for _ in range(60):
        _, total, dones, infos = held.step(action)
        paid, over, last = np.zeros(8), np.zeros(8, dtype=bool), [{} for _ in range(8)]
        for _ in range(4):
            _, rewards, ended, latest = plain.step(action)
            paid += np.where(over, 0.0, rewards)
            for i in (ended & ~over).nonzero()[0]:
                last[i] = latest[i]
            over |= ended
        np.testing.assert_array_equal(dones, over)
        np.testing.assert_allclose(total, paid, atol=1e-6)
        for i in over.nonzero()[0]:
            ends += 1
            np.testing.assert_array_equal(
                infos[i]["terminal_observation"], last[i]["terminal_observation"]
            )
    assert ends > 3


def test_a_monitor_below_counts_control_intervals_and_one_above_decisions():
    def envs():
        env = Sb3VecEnv(gym.make_vec(ID, num_envs=8, autoreset_mode="SameStep"))
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
