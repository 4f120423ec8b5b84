"""The hyperparameter files, which rl-zoo3 reads too."""

import pytest
from torch import nn

from agents.learner import learner_class
from agents.sb3.hyperparameters import FOLDER
from agents.sb3.reward_weight import WeightSchedule
from agents.sb3.wrappers import HeldActions, ScaledReward, StartUpPhase

ADAPTIVE = "agents.sb3.reward_weight.AdaptiveRewardWeight"


def settings(algo="ppo", init="scratch", **changes):
    return learner_class(algo).settings(init, changes)


def test_what_is_trained_in_is_read_as_rl_zoo3_reads_it():
    assert {path.stem for path in FOLDER.glob("*.yml")} == {"ppo", "sac", "screened_ppo"}
    for algo in ("ppo", "sac"):
        fresh, tuned = settings(algo), settings(algo, "imitation")
        assert (fresh.intervals_per_step, tuned.intervals_per_step, tuned.schedule) == (4, 1, None)
        assert fresh.wrappers == ((HeldActions, {"intervals": 4}), (ScaledReward, {"scale": 1.0}))
        assert fresh.schedule.first_weight == 5.0
        assert not {"callback", "env_wrapper", "vec_env_wrapper"} & set(fresh.algorithm)
    assert settings("sac", "imitation").algorithm["policy_kwargs"]["activation_fn"] is nn.Tanh
    screened = settings("screened_ppo")
    assert screened.episode_steps == 1000
    assert screened.wrappers == (
        (StartUpPhase, {"intervals": 300, "travel": 0.2, "penalty": 0.1}),
        (ScaledReward, {"scale": 10.0}),
    )


def test_some_values_of_an_entry_can_be_changed():
    usual, other = settings(), settings(gamma=0.5, n_envs=3, callback=[ADAPTIVE])
    assert (other.n_envs, other.algorithm["gamma"]) == (3, 0.5)
    assert other.schedule == WeightSchedule()
    assert other.algorithm["n_steps"] == usual.algorithm["n_steps"]
    assert other.written["gamma"] == 0.5  # so that a folder is known by it


def test_a_learning_rate_falls_linearly_to_0_at_the_end():
    rate = settings(learning_rate="lin_0.002").algorithm["learning_rate"]
    assert [rate(left) for left in (1.0, 0.5, 0.0, -0.01)] == [0.002, 0.001, 0.0, 0.0]


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"gama": 0.5}, ValueError, "'gama' is not known; choose from"),
        ({"n_envs": "x"}, TypeError, "n_envs = 'x': must be an integer of at least 1"),
        ({"gamma": "x"}, TypeError, "gamma = 'x': must be a real number"),
        ({"learning_rate": -1.0}, ValueError, r"learning_rate = -1\.0: must be"),
        ({"learning_rate": "cos_1"}, ValueError, "learning_rate = 'cos_1': write lin_"),
        ({"callback": ["gym.Other"]}, ValueError, r"callback: lists \['gym.Other'\]"),
        ({"vec_env_wrapper": ["agents.Other"]}, ValueError, "vec_env_wrapper: 'agents.Other'"),
        ({"callback": [{ADAPTIVE: {"evry": 3}}]}, TypeError, "evry"),
    ],
)
def test_other_values_are_refused(changes, error, message):
    with pytest.raises(error, match=message):
        settings(**changes)
