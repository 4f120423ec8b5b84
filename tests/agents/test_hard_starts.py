"""Episodes that begin where another one has gone wrong."""

import numpy as np
import pytest
from stable_baselines3 import PPO

from agents.conditions import Conditions
from agents.sb3.hard_starts import HardStarts
from agents.sb3.layers import layer_of
from agents.sb3.state import restore, state_of
from agents.sb3.training_env import Offer, begin_out_of_step, training_env
from agents.sb3.vec_env import Sb3VecEnv
from rimless_gym import Task
from rimless_gym.kernel.stepping import MODE

N, LIMIT = 8, 60


def again(share, episode_steps=None):
    return Offer({HardStarts: {"share": share}}, episode_steps)


def made(share, episode_steps=None):
    env = training_env(N, Conditions(), Task(), 3, again(share, episode_steps))
    env.reset()
    return env


def resting(env, intervals):
    """The starts of all episodes of wheels that do nothing, in the order in which they begin."""
    native, doing_nothing = layer_of(env, Sb3VecEnv).env, np.zeros((N, 1), dtype=np.float32)
    starts = [*native.states.copy()]
    for _ in range(intervals):
        _, _, dones, _ = env.step(doing_nothing)
        starts += [*native.states[dones].copy()]
    return np.array(starts)


def test_wheels_that_rest_begin_again_where_they_have_begun():
    starts = resting(made(1.0, episode_steps=LIMIT), 4 * LIMIT)
    first, later = starts[:N], starts[N:]
    assert len(later) >= 3 * N  # each of the eight has had its time three times, or fallen
    again = np.abs(later[:, None, :5] - first[None, :, :5]).max(axis=2) < 1e-12
    assert again.any(axis=1).all()


def test_how_an_episode_began_is_told_of_hard_starts_too():
    env = made(1.0, episode_steps=LIMIT)
    native = layer_of(env, Sb3VecEnv)
    for _ in range(4 * LIMIT):
        _, _, dones, _ = env.step(np.zeros((N, 1), dtype=np.float32))
        for i in np.flatnonzero(dones):
            assert native.reset_infos[i]["mode"] == native.env.states[i, MODE]


def test_without_a_share_nothing_is_kept_and_episodes_begin_as_ever():
    starts = resting(made(0.0, episode_steps=LIMIT), 4 * LIMIT)
    assert len(np.unique(starts[:, :5].round(12), axis=0)) == len(starts)


def test_each_start_is_used_once_and_some_episodes_begin_as_ever():
    env = made(0.5, episode_steps=LIMIT)
    starts = resting(env, 20 * LIMIT)
    own = len(np.unique(starts[:, :5].round(12), axis=0))
    # Half of the later episodes begin anew, so that about half of all starts differ.
    assert 0.35 * len(starts) < own < 0.7 * len(starts)
    assert len(layer_of(env, HardStarts).state()["found"]) == own - N


def test_a_wheel_that_walks_has_not_gone_wrong():
    env = made(1.0, episode_steps=LIMIT)
    native = layer_of(env, Sb3VecEnv)
    real = native.env.step

    def walking(actions):
        found = real(actions)
        found[-1]["steps"][: N // 2] = 1  # as though the first half stepped all the time
        return found

    native.env.step = walking
    for _ in range(LIMIT - 1):
        env.step(np.zeros((N, 1), dtype=np.float32))
    before = layer_of(env, HardStarts).state()["starts"]
    layer_of(env, HardStarts).share = 1e-12  # nothing is taken, so that what is kept can be seen
    env.step(np.zeros((N, 1), dtype=np.float32))
    found = layer_of(env, HardStarts).state()["found"]
    np.testing.assert_array_equal(found, before[N // 2 :])


def test_an_episode_that_was_under_way_is_not_judged():
    env = made(1e-12, episode_steps=LIMIT)
    begin_out_of_step(env, lambda seen: np.zeros(len(seen)))
    ended = 0
    for _ in range(LIMIT - 1):
        ended += env.step(np.zeros((N, 1), dtype=np.float32))[2].sum()
    assert ended >= N - 1
    assert len(layer_of(env, HardStarts).state()["found"]) == 0


def test_without_a_share_all_starts_are_forgotten_and_episodes_under_way_are_not_judged():
    env = made(1e-12, episode_steps=LIMIT)
    resting(env, LIMIT + LIMIT // 2)
    kept = layer_of(env, HardStarts)
    assert len(kept.state()["found"]) > 0
    kept.share = 0.0
    resting(env, 1)
    kept.share = 1e-12
    resting(env, LIMIT // 2)
    assert len(kept.state()["found"]) == 0


def test_ranges_are_refused_because_a_start_is_that_of_one_machine():
    conditions = Conditions.of("BUILDABLE", {"pendulum_mass": (1.5, 1.7)}, None, None, None)
    with pytest.raises(ValueError, match=r"HardStarts: share = 0\.3: .* give no ranges"):
        training_env(2, conditions, Task(), 0, again(0.3))


def test_its_state_is_restored():
    env, other = made(0.5, episode_steps=LIMIT), made(0.5, episode_steps=LIMIT)
    resting(env, 3 * LIMIT + 7)
    kept = layer_of(env, HardStarts).state()
    layer_of(other, HardStarts).restore(kept)
    for name, value in layer_of(other, HardStarts).state().items():
        np.testing.assert_equal(value, kept[name])


def test_a_training_that_goes_on_remembers_the_starts_that_went_wrong():
    settings = {"n_steps": LIMIT, "batch_size": N * LIMIT, "n_epochs": 1, "device": "cpu"}
    model, other = (PPO("MlpPolicy", made(0.5, LIMIT), seed=0, **settings) for _ in range(2))
    model.learn(4 * N * LIMIT)
    restore(other, state_of(model))
    kept, again = (layer_of(each.env, HardStarts).state() for each in (model, other))
    assert len(kept["found"]) > 0
    for name, value in kept.items():
        np.testing.assert_equal(again[name], value)


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_that_is_none_is_refused(share):
    with pytest.raises(ValueError, match="share"):
        training_env(2, Conditions(), Task(), 0, again(share))
