"""The hyperparameter files, which rl-zoo3 reads too."""

import pytest
from torch import nn

from agents.learner import learner_class
from agents.sb3.feedforward import BackEmfFeedforward
from agents.sb3.hyperparameters import FOLDER
from agents.sb3.wrappers import HeldActions


def settings(algo="ppo", init="scratch", **changes):
    return learner_class(algo).settings(init, changes)


def test_what_is_trained_in_is_read_as_rl_zoo3_reads_it():
    assert {path.stem for path in FOLDER.glob("*.yml")} == {"ppo", "sac"}
    for algo in ("ppo", "sac"):
        fresh, tuned, prior = (settings(algo, of) for of in ("scratch", "imitation", "prior"))
        assert fresh.algorithm == {"policy": "MlpPolicy"}
        kinds = [kind for kind, _ in prior.wrappers]
        assert (kinds[0], kinds[-1]) == (BackEmfFeedforward, HeldActions)  # from the inside out
        assert [each.intervals_per_step for each in (fresh, tuned, prior)] == [1, 1, 2]
        assert (fresh.episode_steps, prior.episode_steps) == (None, 500)
        assert not {"env_wrapper", "vec_env_wrapper"} & set(prior.algorithm)
    assert settings("sac", "imitation").algorithm["policy_kwargs"]["activation_fn"] is nn.Tanh


def test_some_values_of_an_entry_can_be_changed():
    usual, other = settings(init="prior"), settings(init="prior", gamma=0.5, n_envs=3)
    assert (other.n_envs, other.algorithm["gamma"]) == (3, 0.5)
    assert other.algorithm["n_steps"] == usual.algorithm["n_steps"]
    assert other.written["gamma"] == 0.5  # so that a folder is known by it


def test_a_learning_rate_falls_linearly_to_0_at_the_end():
    rate = settings(learning_rate="lin_0.002").algorithm["learning_rate"]
    assert [rate(left) for left in (1.0, 0.5, 0.0, -0.01)] == [0.002, 0.001, 0.0, 0.0]


HELD = "agents.sb3.wrappers.HeldActions"


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"gama": 0.5}, ValueError, "'gama' is not known; choose from"),
        ({"n_envs": "x"}, TypeError, "n_envs = 'x': must be an integer of at least 1"),
        ({"learning_rate": -1.0}, ValueError, r"learning_rate = -1\.0: must be"),
        ({"n_epochs": 0}, ValueError, "n_epochs = 0: must be an integer of at least 1"),
        ({"gamma": 9.0}, ValueError, r"gamma = 9\.0: must be from 0 to 1"),
        ({"policy_kwargs": 3}, TypeError, "policy_kwargs = 3: must be a"),
        ({"policy_kwargs": {"activation_fn": "tanh"}}, ValueError, r"'tanh': choose from \['Tanh'"),
        ({"noise": {"first": 0.1}}, ValueError, "noise: changes only in a training with a prior"),
        ({"learning_rate": "cos_1"}, ValueError, "learning_rate = 'cos_1': write lin_"),
        ({"env_wrapper": ["gym.Other"]}, ValueError, r"env_wrapper: lists \['gym.Other'\]"),
        ({"vec_env_wrapper": ["agents.Other"]}, ValueError, "vec_env_wrapper: 'agents.Other'"),
        ({"vec_env_wrapper": {HELD: {"of": 3}}}, ValueError, "unexpected keyword argument 'of'"),
        ({"vec_env_wrapper": "math.sqrt"}, ValueError, "is no VecEnvWrapper"),
    ],
)
def test_other_values_are_refused(changes, error, message):
    with pytest.raises(error, match=message):
        settings(**changes)
