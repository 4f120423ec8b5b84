"""Sb3VecEnv gives what stable-baselines3's own DummyVecEnv of single environments gives."""

from inspect import signature

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecCheckNan,
)

from agents import Sb3VecEnv
from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL, Task
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.equations import DOUBLE

ID, SPEED_ID = "RimlessWheel-v0", "RimlessWheelSpeed-v0"
REST = {"mode": "double_stance"}


def native(n, **settings):
    return gym.make_vec(ID, num_envs=n, **{"autoreset_mode": AutoresetMode.SAME_STEP} | settings)


def both(n, seed=0, id_=ID, **settings):
    """Our Sb3VecEnv and a DummyVecEnv, made and seeded alike, not yet reset."""
    kinds = Sb3VecEnv, DummyVecEnv
    return [make_vec_env(id_, n, seed, vec_env_cls=kind, **settings) for kind in kinds]


def whirling(n, k):
    """Full voltage that changes sign slowly, so that wheels soon fall; shape (n, 1)."""
    return np.sign(np.sin(k / 20 + np.arange(n)))[:, None].astype(np.float32)


def assert_same(info, other):
    """The same entries with the same values where an episode ends; wall-clock times aside."""
    if "terminal_observation" not in other:  # made without the entries that nobody reads
        assert info == {"TimeLimit.truncated": other["TimeLimit.truncated"]}
        return
    info, other = dict(info), dict(other)
    ends = [each.pop("terminal_observation", None) for each in (info, other)]
    assert (ends[0] is None) == (ends[1] is None)
    if ends[0] is not None:
        np.testing.assert_array_equal(*ends)
    for each in (info, other):
        if "episode" in each:
            each["episode"] = each["episode"] | {"t": 0.0}
    assert info == other
    assert {name: type(value) for name, value in info.items()} == {
        name: type(value) for name, value in other.items()
    }


MANY = {
    "ranges": {"pendulum_mass": (2.0, 2.4), "slope": (-0.02, 0.02)},
    "disturbances": {
        "pushes": {"rate": 5.0, "impulse": (0.0, 0.1)},
        "sensor_noise": {"leg_angle": 0.01},
    },
    "control_period": 0.02,
    "actions": "current",
    "starts": {"whirling": 1.0},
}


@pytest.mark.parametrize(
    ("id_", "settings", "ends"),
    [
        (ID, {"max_episode_steps": 40, "params": THESIS_PHYSICAL, "task": Task(0.8)}, "time"),
        (ID, {}, "fall"),
        (ID, MANY, "fall"),
        (SPEED_ID, {}, "fall"),
        (SPEED_ID, {"speeds": (0.5, 0.7), "control_period": 0.1}, "fall"),
    ],
    ids=["short", "plain", "many", "speed", "other speeds"],
)
def test_rows_equal_single_environments_bit_for_bit_over_many_episodes(id_, settings, ends):
    keywords = {"info_keywords": ("distance", "failure")}
    ours, theirs = both(4, 7, id_, env_kwargs=settings, monitor_kwargs=keywords)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    found = set()
    for k in range(300):
        actions = whirling(4, k)
        one, other = ours.step(actions), theirs.step(actions)
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
            assert mine.dtype == yours.dtype
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
            if "episode" in yours:
                found.add("time" if yours["TimeLimit.truncated"] else "fall")
        assert ours.reset_infos == theirs.reset_infos
    assert ends in found
    for name in ("params", "task"):
        assert ours.get_attr(name) == theirs.get_attr(name)


def test_the_test_above_has_every_argument_of_the_environment():
    other = {"params", "task", "render_mode", "max_episode_steps"}
    assert set(signature(RimlessWheelEnv).parameters) <= set(MANY) | other


def test_rows_may_have_different_params():
    params = (THESIS_NOMINAL, THESIS_PHYSICAL, PROTOTYPE)
    makers = [lambda params=each: gym.make(ID, params=params) for each in params]
    ours, theirs = Sb3VecEnv(makers), DummyVecEnv(makers)
    for env in (ours, theirs):
        env.seed(3)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(60):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
    assert ours.get_attr("params") == list(params)
    named = make_vec_env(ID, 2, vec_env_cls=Sb3VecEnv, env_kwargs={"params": "PROTOTYPE"})
    assert named.get_attr("params") == [PROTOTYPE] * 2


@pytest.mark.parametrize(("algorithm", "id_"), [(PPO, ID), (PPO, SPEED_ID), (SAC, ID)])
def test_a_policy_learns_the_same_weights_as_in_single_environments(algorithm, id_):
    settings = {PPO: {"n_steps": 32, "batch_size": 32}, SAC: {"learning_starts": 50}}[algorithm]
    learned = []
    for env in both(4, 1, id_, env_kwargs={"max_episode_steps": 15} if id_ == ID else {}):
        model = algorithm("MlpPolicy", env, seed=1, device="cpu", **settings)
        model.learn(256 if algorithm is PPO else 120)
        learned.append(torch.cat([p.detach().ravel() for p in model.policy.parameters()]))
    assert torch.equal(*learned)


def test_a_last_observation_is_a_copy_that_later_steps_do_not_change():
    env = Sb3VecEnv(native(6, max_episode_steps=25))
    env.reset()
    kept = []
    for k in range(60):
        observations, _, dones, infos = env.step(whirling(6, k))
        for i in np.flatnonzero(dones):
            last = infos[i]["terminal_observation"]
            kept.append((last, last.copy()))
            assert not np.shares_memory(last, observations)
            assert not np.array_equal(last, observations[i])
    assert len(kept) >= 6 * 2
    for last, before in kept:
        np.testing.assert_array_equal(last, before)


def test_single_monitors_write_their_episodes(tmp_path):
    written = []
    for kind in (Sb3VecEnv, DummyVecEnv):
        folder, limit = tmp_path / kind.__name__, {"max_episode_steps": 20}
        about = {"monitor_dir": str(folder), "monitor_kwargs": {"info_keywords": ("distance",)}}
        env = make_vec_env(ID, 3, 2, vec_env_cls=kind, env_kwargs=limit, **about)
        env.reset()
        for k in range(45):
            env.step(whirling(3, k))
        assert env.env_is_wrapped(Monitor) == [True] * 3
        env.close()
        lines = [path.read_text().splitlines()[1:] for path in sorted(folder.iterdir())]
        rows = [[line.split(",") for line in each] for each in lines]
        written.append([[(row[:2], row[3:]) for row in each] for each in rows])  # without times
    assert written[0] == written[1]
    assert sum(map(len, written[0])) > 2 * 3


def test_the_checkers_of_stable_baselines3_pass_without_warnings(recwarn):
    check_env(gym.make(ID))
    env = VecCheckNan(Sb3VecEnv(native(2)), raise_exception=True)
    env.reset()
    for k in range(20):
        env.step(whirling(2, k))
    assert not recwarn.list


def test_options_and_seeds_apply_to_one_reset_only():
    states = [(1.5, 0.1 * i, 1.0, 0.0) for i in range(3)]
    options = [{"state": x} for x in states] + [REST, {}, {"params": PROTOTYPE}]
    env, alone = Sb3VecEnv(native(6)), [gym.make(ID) for _ in range(6)]
    env.seed(5)
    env.set_options(options)
    expected = [alone[i].reset(seed=5 + i, options=options[i])[0] for i in range(6)]
    np.testing.assert_array_equal(env.reset(), expected)
    assert env.get_attr("params") == [BUILDABLE] * 5 + [PROTOTYPE]
    again = env.reset()
    np.testing.assert_array_equal(again, [each.reset()[0] for each in alone])
    assert not np.array_equal(again, expected)
    env.set_options(REST)
    np.testing.assert_array_equal(env.reset(), [each.reset(options=REST)[0] for each in alone])
    assert [info["mode"] for info in env.reset_infos] == [DOUBLE] * 6


def test_attributes_are_those_of_the_rows():
    params = [PROTOTYPE, THESIS_NOMINAL, PROTOTYPE]
    env = Sb3VecEnv(native(3, params=params, task=Task(horizon=9.0)))
    env.reset()
    assert env.get_attr("params", [1, 2]) == [THESIS_NOMINAL, PROTOTYPE]
    assert env.get_attr("task", 0) == [Task(horizon=9.0)]
    np.testing.assert_array_equal(env.get_attr("state", 2), env.env.states[2:])
    assert env.get_attr("action_space") == [env.action_space] * 3
    assert env.env_method("get_wrapper_attr", "params", indices=0) == [PROTOTYPE]
    assert env.env_is_wrapped(Monitor) == [False] * 3
    assert env.spec.id == ID
    with pytest.raises(NotImplementedError, match="set_options"):
        env.set_attr("params", PROTOTYPE)
    with pytest.raises(NotImplementedError, match=r"'compute_reward'.*Sb3VecEnv\.env"):
        env.env_method("compute_reward")


def test_the_native_environment_takes_commands_between_steps():
    envs = gym.make_vec(SPEED_ID, num_envs=3, autoreset_mode=AutoresetMode.SAME_STEP)
    env = Sb3VecEnv(envs)
    env.set_options({"speed": 0.4})
    assert env.reset()[:, 6] == pytest.approx(np.full(3, -0.25), abs=1e-6)
    envs.set_command(0.6, np.array([False, True, False]))
    seen = env.step(np.zeros((3, 1), np.float32))[0]
    assert seen[:, 6] == pytest.approx([-0.25, 0.75, -0.25], abs=1e-6)


class Halved(gym.RewardWrapper):
    def reward(self, reward):
        return reward / 2


def singles(*makers):
    return lambda: Sb3VecEnv(list(makers))


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (singles(lambda: Halved(gym.make(ID))), ValueError, "Halved: .*VecEnvWrapper.*DummyVecEnv"),
        (
            singles(*(lambda n=n: gym.make(ID, max_episode_steps=n) for n in (9, 8))),
            ValueError,
            "environment 1 has max_episode_steps = 8, the first 9",
        ),
        (
            singles(lambda: gym.make(ID), lambda: gym.make(SPEED_ID)),
            ValueError,
            "environment 1 has native = .*use DummyVecEnv",
        ),
        (
            lambda: Sb3VecEnv(gym.wrappers.vector.RecordEpisodeStatistics(native(2))),
            TypeError,
            "without wrappers.*VecMonitor",
        ),
        (
            lambda: Sb3VecEnv(native(2, autoreset_mode=AutoresetMode.NEXT_STEP)),
            ValueError,
            r"autoreset_mode=AutoresetMode\.SAME_STEP",
        ),
    ],
)
def test_unsuitable_environments_are_refused_with_the_remedy(make, error, message):
    with pytest.raises(error, match=message):
        make()
