"""Sb3VecEnv against stable-baselines3's own DummyVecEnv of single environments, and its tools."""

import copy
import json
import pickle
from inspect import signature

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecCheckNan,
    VecEnvWrapper,
    VecMonitor,
    VecNormalize,
)

from agents import Sb3VecEnv
from rimless_gym import PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL, Task
from rimless_gym.envs.disturbances import Disturbances, Pushes, SensorNoise
from rimless_gym.envs.env import RimlessWheelEnv

ID = "RimlessWheel-v0"
REST = {"mode": "double_stance"}


def native(n, **settings):
    settings = {"autoreset_mode": AutoresetMode.SAME_STEP} | settings
    return gym.make_vec(ID, num_envs=n, **settings)


def both(n, seed=0, **settings):
    """Ours and stable-baselines3's, made alike, seeded and not yet reset."""
    return [
        make_vec_env(ID, n, seed, vec_env_cls=kind, **settings) for kind in (Sb3VecEnv, DummyVecEnv)
    ]


def whirling(n, k):
    """Full voltage, now this way, now that: the wheel soon falls. (n, 1)"""
    return np.sign(np.sin(k / 20 + np.arange(n)))[:, None].astype(np.float32)


def assert_same(info, other):
    """The same entries with the same values; wall-clock times aside."""
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


@pytest.mark.parametrize("n", [1, 5])
@pytest.mark.parametrize("limit", [40, 2000])
def test_it_gives_what_single_environments_give_bit_for_bit_over_many_episodes(n, limit):
    task, machine = Task(value_of_distance=0.8), THESIS_PHYSICAL.replace(hub_damping=0.1)
    ours, theirs = both(
        n,
        seed=7,
        env_kwargs={"params": machine, "task": task, "max_episode_steps": limit},
        monitor_kwargs={"info_keywords": ("distance", "failure")},
    )
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    assert ours.reset_infos == theirs.reset_infos
    ends = set()
    for k in range(400):
        one, other = ours.step(whirling(n, k)), theirs.step(whirling(n, k))
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
            assert mine.dtype == yours.dtype
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
            if "episode" in mine:
                ends.add("time" if mine["TimeLimit.truncated"] else "fall")
        assert ours.reset_infos == theirs.reset_infos
    assert ("time" if limit == 40 else "fall") in ends


def test_rows_may_be_different_machines_each_as_on_its_own():
    machines = (THESIS_NOMINAL, THESIS_PHYSICAL, PROTOTYPE)
    makers = [lambda params=params: gym.make(ID, params=params) for params in machines]
    ours, theirs = Sb3VecEnv(makers), DummyVecEnv(makers)
    for env in (ours, theirs):
        env.seed(3)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(100):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
    assert ours.get_attr("params") == list(machines)


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_a_policy_learns_the_very_same_in_it(algorithm):
    settings = {PPO: {"n_steps": 64, "batch_size": 64}, SAC: {"learning_starts": 50}}[algorithm]
    learned = []
    for env in both(4, seed=1, env_kwargs={"max_episode_steps": 15}):
        model = algorithm("MlpPolicy", env, seed=1, device="cpu", **settings)
        model.learn(512 if algorithm is PPO else 160)
        assert model.ep_info_buffer
        learned.append(torch.cat([p.detach().ravel() for p in model.policy.parameters()]))
    assert torch.equal(*learned)


class Recorded(VecEnvWrapper):
    """Keeps all rewards, and what its rows said of their ends."""

    def __init__(self, venv):
        super().__init__(venv)
        self.rewards, self.truncated, self.dones = [], [], []

    def reset(self):
        return self.venv.reset()

    def step_wait(self):
        observations, rewards, dones, infos = self.venv.step_wait()
        self.rewards.append(rewards.copy())
        self.dones.append(dones)
        self.truncated.append([info["TimeLimit.truncated"] for info in infos])
        return observations, rewards, dones, infos


def test_ppo_goes_on_valuing_a_row_that_ran_out_of_time_but_not_one_that_fell():
    env = Recorded(Sb3VecEnv(native(8, max_episode_steps=30)))
    model = PPO("MlpPolicy", env, seed=0, device="cpu", n_steps=128, batch_size=64, n_epochs=1)
    with torch.no_grad():
        model.policy.log_std.fill_(2.0)  # full voltage this way or that: some fall
    model.learn(1)
    added = model.rollout_buffer.rewards != np.array(env.rewards)
    truncated, dones = np.array(env.truncated), np.array(env.dones)
    np.testing.assert_array_equal(added, truncated)
    assert truncated.any()
    assert (dones & ~truncated).any()


def test_a_last_observation_is_a_copy_that_later_steps_do_not_change():
    env = Sb3VecEnv(native(6, max_episode_steps=25))
    env.reset()
    kept = []
    for k in range(100):
        observations, _, dones, infos = env.step(whirling(6, k))
        for i in np.flatnonzero(dones):
            last = infos[i]["terminal_observation"]
            kept.append((last, last.copy()))
            assert not np.shares_memory(last, observations)
            assert not np.array_equal(last, observations[i])
    assert len(kept) >= 6 * 4
    for last, before in kept:
        np.testing.assert_array_equal(last, before)


#: Ways to read a dictionary that has these entries.
READERS = {
    "dict": lambda info, names: dict(info),
    "unpacking": lambda info, names: {**info},
    "keywords": lambda info, names: (lambda **entries: entries)(**info),
    "update": lambda info, names: (entries := {}, entries.update(info))[0],
    "or": lambda info, names: info | {},
    "or from the right": lambda info, names: {} | info,
    "copy": lambda info, names: info.copy(),
    "copy.copy": lambda info, names: copy.copy(info),
    "copy.deepcopy": lambda info, names: copy.deepcopy(info),
    "pickle": lambda info, names: pickle.loads(pickle.dumps(info)),
    "json": lambda info, names: json.loads(json.dumps(info)),
    "repr": lambda info, names: eval(repr(info), {"inf": np.inf}),
    "iteration": lambda info, names: {name: info[name] for name in info},
    "reversed": lambda info, names: {name: info[name] for name in reversed(info)},
    "items": lambda info, names: dict(info.items()),
    "keys, values": lambda info, names: dict(zip(info.keys(), info.values(), strict=True)),
    "brackets": lambda info, names: {name: info[name] for name in names},
    "get": lambda info, names: {name: info.get(name, "none") for name in names},
    "setdefault": lambda info, names: {name: info.setdefault(name, "none") for name in names},
    "in": lambda info, names: {name: info[name] for name in names if name in info},
    "pop": lambda info, names: {name: info.pop(name) for name in names},
    "popitem": lambda info, names: dict(info.popitem() for _ in range(len(info))),
}


@pytest.fixture
def unread():
    """A row's info of a step that nobody has looked at, and what it should hold."""
    ours, theirs = both(2)
    for env in (ours, theirs):
        env.reset()
    actions = whirling(2, 0)
    return ours.step(actions)[3][1], theirs.step(actions)[3][1]


@pytest.mark.parametrize("reader", READERS)
def test_an_info_reads_as_if_it_had_been_there_all_along(unread, reader):
    info, wanted = unread
    got = READERS[reader](info, list(wanted))
    assert got == wanted
    assert type(got) is dict


def test_an_unread_info_equals_what_it_should_hold(unread):
    info, wanted = unread
    assert (info != {}, info != wanted) == (True, False)
    assert wanted == info
    assert len(info) == len(wanted)
    assert isinstance(info, dict)


def test_what_an_info_does_not_hold_is_missing_and_what_is_written_stays(unread):
    info, wanted = unread
    info["distance"], info["mine"] = "other", 1
    assert info == wanted | {"distance": "other", "mine": 1}
    del info["distance"]
    assert "distance" not in info
    assert info.get("nothing") is None
    assert "nothing" not in info
    with pytest.raises(KeyError, match="nothing"):
        info["nothing"]


def test_infos_read_late_are_those_of_their_step():
    ours, theirs = both(3)
    for env in (ours, theirs):
        env.reset()
    steps = [(ours.step(whirling(3, k))[3], theirs.step(whirling(3, k))[3]) for k in range(90)]
    for mine, yours in steps:
        for info, wanted in zip(mine, yours, strict=True):
            assert_same(info, wanted)


def test_options_reach_their_rows_once_and_seeds_count_once():
    states = [(1.5, 0.1 * i, 1.0, 0.0) for i in range(3)]
    options = [{"state": x} for x in states] + [REST, {}, {"params": PROTOTYPE}]
    env, alone = Sb3VecEnv(native(6)), [gym.make(ID) for _ in range(6)]
    env.seed(5)
    env.set_options(options)
    expected = [alone[i].reset(seed=5 + i, options=options[i])[0] for i in range(6)]
    np.testing.assert_array_equal(env.reset(), expected)
    assert env.get_attr("params") == [THESIS_PHYSICAL] * 5 + [PROTOTYPE]
    again = env.reset()
    np.testing.assert_array_equal(again, [each.reset()[0] for each in alone])
    assert not np.array_equal(again, expected)
    env.set_options(REST)
    np.testing.assert_array_equal(env.reset(), [each.reset(options=REST)[0] for each in alone])
    assert [info["mode"] for info in env.reset_infos] == ["double_stance"] * 6


def test_options_that_fit_no_row_are_refused():
    env = Sb3VecEnv(native(2))
    env.set_options([{}])
    with pytest.raises(ValueError, match="1 options for 2 rows"):
        env.reset()
    for name in ("gravity", "reset_mask"):
        env.set_options({name: 1})
        with pytest.raises(ValueError, match=f"unknown reset option '{name}'"):
            env.reset()


def test_vec_monitor_counts_episodes_as_monitors_do(tmp_path):
    limit = {"max_episode_steps": 50}
    ours = VecMonitor(Sb3VecEnv(native(3, **limit)), str(tmp_path), info_keywords=("distance",))
    theirs = make_vec_env(ID, 3, env_kwargs=limit, monitor_kwargs={"info_keywords": ("distance",)})
    for env in (ours, theirs):
        env.seed(2)
        env.reset()
    seen = 0
    for k in range(160):
        one, other = ours.step(whirling(3, k))[3], theirs.step(whirling(3, k))[3]
        for mine, yours in zip(one, other, strict=True):
            assert ("episode" in mine) == ("episode" in yours)
            if "episode" in mine:
                seen += 1
                assert mine["episode"]["r"] == pytest.approx(yours["episode"]["r"], abs=1e-5)
                assert mine["episode"]["l"] == yours["episode"]["l"]
                assert mine["episode"]["distance"] == yours["episode"]["distance"]
    ours.close()
    header, names, *episodes = (tmp_path / "monitor.csv").read_text().splitlines()
    assert json.loads(header[1:])["env_id"] == ID
    assert names == "r,l,t,distance"
    assert len(episodes) == seen >= 9


def test_monitors_of_single_environments_write_their_files(tmp_path):
    env = make_vec_env(
        ID,
        3,
        0,
        monitor_dir=str(tmp_path),
        vec_env_cls=Sb3VecEnv,
        env_kwargs={"max_episode_steps": 20},
    )
    env.reset()
    for k in range(45):
        env.step(whirling(3, k))
    assert env.env_is_wrapped(Monitor) == [True] * 3
    lengths = env.env_method("get_episode_lengths")
    rewards = env.env_method("get_episode_rewards", indices=[1])
    env.close()
    for i in range(3):
        rows = (tmp_path / f"{i}.monitor.csv").read_text().splitlines()[2:]
        assert [int(row.split(",")[1]) for row in rows] == lengths[i]
        assert sum(lengths[i]) >= 40
    assert len(rewards[0]) == len(lengths[1])


def test_vec_normalize_sees_the_same_and_is_saved_and_loaded(tmp_path):
    ours, theirs = (VecNormalize(env) for env in both(3, env_kwargs={"max_episode_steps": 40}))
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(100):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
    ours.save(tmp_path / "normalize.pkl")
    loaded = VecNormalize.load(tmp_path / "normalize.pkl", Sb3VecEnv(native(3)))
    raw = ours.get_original_obs()
    np.testing.assert_array_equal(loaded.normalize_obs(raw), ours.normalize_obs(raw))


def test_evaluate_policy_finds_the_same_returns():
    found = []
    for env in both(3, seed=9, env_kwargs={"max_episode_steps": 60}):
        model = PPO("MlpPolicy", env, seed=0, device="cpu", n_steps=8, batch_size=8)
        env.seed(9)
        found.append(evaluate_policy(model, env, 7, return_episode_rewards=True))
    assert found[0] == found[1]
    assert len(found[0][0]) == 7


def test_stable_baselines3_finds_nothing_amiss(recwarn):
    check_env(gym.make(ID))
    env = VecCheckNan(Sb3VecEnv(native(2)), raise_exception=True)
    env.reset()
    for k in range(20):
        env.step(whirling(2, k))
    assert not recwarn.list


def test_attributes_are_those_of_the_rows():
    env = Sb3VecEnv(
        native(3, params=[PROTOTYPE, THESIS_NOMINAL, PROTOTYPE], task=Task(horizon=9.0))
    )
    env.reset()
    assert env.get_attr("params", [1, 2]) == [THESIS_NOMINAL, PROTOTYPE]
    assert env.get_attr("task", 0) == [Task(horizon=9.0)]
    np.testing.assert_array_equal(env.get_attr("state", 2), env.env.states[2:])
    assert env.get_attr("action_space") == [env.action_space] * 3
    assert env.env_method("get_wrapper_attr", "params", indices=0) == [PROTOTYPE]
    assert env.has_attr("max_episode_steps")
    assert not env.has_attr("gravity")
    assert env.env_is_wrapped(Monitor) == [False] * 3
    assert env.spec.id == ID
    with pytest.raises(NotImplementedError, match="set_options"):
        env.set_attr("params", PROTOTYPE)
    with pytest.raises(NotImplementedError, match=r"'compute_reward'.*Sb3VecEnv\.env"):
        env.env_method("compute_reward")


class Halved(gym.RewardWrapper):
    def reward(self, reward):
        return reward / 2


@pytest.mark.parametrize(
    ("wrap", "message"),
    [
        (Halved, "wrapper Halved: .*VecEnvWrapper.*DummyVecEnv"),
        (gym.wrappers.TimeAwareObservation, "wrapper TimeAwareObservation"),
        (lambda env: Monitor(Halved(Monitor(env))), "wrapper Halved"),
        (lambda env: Monitor(env, allow_early_resets=False), "wrapper Monitor: .*early"),
    ],
)
def test_wrappers_whose_part_rows_cannot_play_are_refused_by_name(wrap, message):
    with pytest.raises(ValueError, match=message):
        make_vec_env(ID, 2, wrapper_class=wrap, vec_env_cls=Sb3VecEnv)


def test_pictures_are_those_of_the_single_environments():
    ours, theirs = both(3, env_kwargs={"render_mode": "rgb_array"})
    for env in (ours, theirs):
        env.reset()
        env.step(whirling(3, 0))
    for mine, yours in zip(ours.get_images(), theirs.get_images(), strict=True):
        np.testing.assert_array_equal(mine, yours)
    np.testing.assert_array_equal(ours.render(), theirs.render())
    grid = Sb3VecEnv(native(16, render_mode="rgb_array"))
    grid.reset()
    np.testing.assert_array_equal(grid.render(), grid.env.render())
    with pytest.raises(ValueError, match=r"render_mode = 'human': .*'rgb_array'"):
        both(1, env_kwargs={"render_mode": "human"})


def test_randomised_and_disturbed_environments_are_as_random_and_disturbed_in_rows():
    settings = {
        "ranges": {"pendulum_mass": (2.0, 2.4), "slope": (-0.02, 0.02)},
        "disturbances": Disturbances(
            pushes=Pushes(rate=5.0, impulse=(0.0, 0.1)), sensor_noise=SensorNoise(leg_angle=0.01)
        ),
    }
    assert set(signature(RimlessWheelEnv).parameters) == {
        *("params", "task", "render_mode", "ranges", "disturbances")  # all of them are handed on
    }
    ours, theirs = both(3, seed=4, env_kwargs=settings)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(200):
        one, other = ours.step(whirling(3, k)), theirs.step(whirling(3, k))
        for mine, yours in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(mine, yours)
        for mine, yours in zip(one[3], other[3], strict=True):
            assert_same(mine, yours)
    assert len({machine.pendulum_mass for machine in ours.get_attr("params")}) == 3


def test_what_are_no_native_rows_is_refused_with_the_remedy():
    with pytest.raises(TypeError, match=r"CartPole.*must be a RimlessWheelEnv.*DummyVecEnv"):
        make_vec_env("CartPole-v1", 2, vec_env_cls=Sb3VecEnv)
    with pytest.raises(TypeError, match=r"without wrappers.*VecMonitor"):
        Sb3VecEnv(gym.wrappers.vector.RecordEpisodeStatistics(native(2)))
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        with pytest.raises(ValueError, match=r"autoreset_mode=AutoresetMode\.SAME_STEP"):
            Sb3VecEnv(native(2, autoreset_mode=mode))
    with pytest.raises(ValueError, match="at least one"):
        Sb3VecEnv([])
    with pytest.raises(ValueError, match=r"environment 1 has max_episode_steps = 8, the first 9"):
        Sb3VecEnv([lambda limit=limit: gym.make(ID, max_episode_steps=limit) for limit in (9, 8)])
