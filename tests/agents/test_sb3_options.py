"""Options, attributes and wrappers of Sb3VecEnv's rows; what it cannot do is refused."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor

from agents import Sb3VecEnv
from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_NOMINAL, Task
from rimless_gym.equations import DOUBLE
from tests.agents.sb3_rows import ID, REST, native


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


def test_machines_may_be_named_in_stable_baselines3_too():
    kwargs = {"params": "PROTOTYPE", "task": {"slip_penalty": 0.0}}
    env = make_vec_env(ID, n_envs=2, vec_env_cls=Sb3VecEnv, env_kwargs=kwargs)
    assert env.get_attr("params") == [PROTOTYPE] * 2
    with pytest.raises(ValueError, match="unknown preset 'CONCRETE': choose from"):
        make_vec_env(ID, vec_env_cls=Sb3VecEnv, env_kwargs={"params": "CONCRETE"})


def test_too_few_options_and_unknown_ones_are_refused():
    env = Sb3VecEnv(native(2))
    env.set_options([{}])
    with pytest.raises(ValueError, match="1 options for 2 rows"):
        env.reset()
    for name in ("gravity", "reset_mask"):
        env.set_options({name: 1})
        with pytest.raises(ValueError, match=f"unknown reset option '{name}'"):
            env.reset()


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
def test_unsupported_wrappers_are_refused_by_name(wrap, message):
    with pytest.raises(ValueError, match=message):
        make_vec_env(ID, 2, wrapper_class=wrap, vec_env_cls=Sb3VecEnv)


def test_unsuitable_environments_are_refused_with_the_remedy():
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


def test_some_rows_can_begin_anew_while_the_others_walk_on():
    env, rows = Sb3VecEnv(native(4)), np.array([False, True, False, True])
    env.set_options({"state": (1.5, 0.1, 1.0, 0.0)})
    env.reset()
    walking = env.step(np.full((4, 1), 0.3, dtype=np.float32))[0]
    begun = env.begin(rows, REST)
    np.testing.assert_array_equal(begun[~rows], walking[~rows])
    resting = gym.make(ID).reset(options=REST)[0]
    np.testing.assert_array_equal(begun[rows], [resting] * 2)
    assert [info["mode"] == DOUBLE for info in env.reset_infos] == rows.tolist()
