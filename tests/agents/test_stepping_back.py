"""The charge for steps backward."""

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.sb3.layers import layer_of
from agents.sb3.setting_off import SettingOff
from agents.sb3.stepping_back import SteppingBack
from agents.sb3.training_env import Offer, training_env
from rimless_gym import Task

N = 16

#: Steps backward by touchdowns and the steps that `info` counts.
BACKWARD = {(0, 0): 0, (1, 1): 0, (1, -1): 1, (2, 0): 1, (2, -2): 2, (2, 2): 0}


def made(charge=0.0, setting_off=0, episode_steps=None):
    layers = {SteppingBack: {"charge": charge}, SettingOff: {"intervals": setting_off}}
    env = training_env(N, Conditions(), Task(), 7, Offer(layers, episode_steps))
    env.reset()
    return env


def test_each_step_backward_is_charged_and_no_step_forward():
    charged, plain = made(0.3), made()
    rng, seen = np.random.default_rng(0), set()
    for _ in range(150):
        actions = rng.choice([-1.0, 1.0], size=(N, 1)).astype(np.float32)
        _, rewards, _, infos = charged.step(actions)
        less = plain.step(actions)[1] - rewards
        for i, info in enumerate(infos):
            touchdowns, steps = info["touchdowns"], info["steps"]
            seen.add((touchdowns, steps))
            backward = BACKWARD.get((touchdowns, steps))
            if backward is not None:  # a wheel that comes to rest may rock more often
                assert less[i] == pytest.approx(0.3 * backward, abs=1e-6)
    assert {(0, 0), (1, 1), (1, -1)} <= seen


def test_the_charge_may_change_and_what_is_monitored_has_none():
    env = made(episode_steps=20)
    layer_of(env, SteppingBack).charge = 0.5
    rng = np.random.default_rng(1)
    earned, ended, backward = np.zeros(N), {}, np.zeros(N)
    for _ in range(20):
        actions = rng.choice([-1.0, 1.0], size=(N, 1)).astype(np.float32)
        _, rewards, dones, infos = env.step(actions)
        for i in set(range(N)) - set(ended):
            earned[i] += rewards[i]
            backward[i] += (infos[i]["touchdowns"] - infos[i]["steps"]) / 2
            if dones[i]:
                ended[i] = infos[i]["episode"]["r"]
    assert backward.max() > 0
    monitored = [ended[i] for i in range(N)]
    np.testing.assert_allclose(monitored, earned + 0.5 * backward, atol=1e-4)


def test_while_wheels_set_off_steps_backward_are_free():
    charged, plain = made(0.3, 40), made(0.0, 40)
    rng, backward = np.random.default_rng(0), np.zeros(2)
    for _ in range(150):
        actions = rng.choice([-1.0, 1.0], size=(N, 1)).astype(np.float32)
        walking = ~layer_of(charged, SettingOff).setting_off
        _, rewards, _, infos = charged.step(actions)
        less = plain.step(actions)[1] - rewards
        back = np.array([(info["touchdowns"] - info["steps"]) / 2 for info in infos])
        np.testing.assert_allclose(less, 0.3 * walking * back, atol=1e-6)
        backward += back[walking].sum(), back[~walking].sum()
    assert (backward > 0).all()


def test_a_negative_charge_is_refused():
    with pytest.raises(ValueError, match=r"charge = -0\.1"):
        made(-0.1)
