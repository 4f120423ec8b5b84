"""Hyperparameters with which nothing can be learned are refused by name."""

import pytest

from agents import learners


@pytest.mark.parametrize(
    ("algo", "changes", "error", "message"),
    [
        ("ppo", {"n_epochs": 0}, ValueError, "n_epochs = 0: must be an integer of at least 1"),
        ("ppo", {"target_kl": "x"}, TypeError, "target_kl = 'x': must be a real number"),
        ("ppo", {"gamma": 1.5}, ValueError, r"gamma = 1\.5: must be at least 0 and at most 1"),
        ("ppo", {"max_grad_norm": 0.0}, ValueError, r"max_grad_norm = 0\.0: must be greater"),
        ("ppo", {"clip_range": 0}, ValueError, "clip_range = 0"),
        ("ppo", {"n_envs": 10**12}, ValueError, "n_envs = 10+: .* at most 65536"),
        ("ppo", {"use_sde": True}, ValueError, "'use_sde' is not known; choose from"),
        ("ppo", {"policy_kwargs": "-" * 20_000 + "1"}, ValueError, "policy_kwargs = .*write dict"),
        ("sac", {"train_freq": 0}, ValueError, "train_freq = 0: must be an integer"),
        ("sac", {"train_freq": [1, "day"]}, ValueError, "count in 'step' or 'episode'"),
        ("sac", {"tau": -1.0}, ValueError, r"tau = -1\.0: must be at least 0"),
        ("sac", {"ent_coef": "much"}, ValueError, "ent_coef = 'much': write a number, auto"),
        ("sac", {"gradient_steps": 0}, ValueError, "gradient_steps = 0"),
        ("screened_ppo", {"learning_rate": "lin_0.002"}, ValueError, "must be a number here"),
        (
            "screened_ppo",
            {"policy_kwargs": "dict(net_arch=dict(pi=[8], vf=[8]))"},
            ValueError,
            r"pi = \[8\]: must be empty",
        ),
    ],
)
def test_what_cannot_work_is_refused(algo, changes, error, message):
    with pytest.raises(error, match=message):
        learners.learner(algo).settings("scratch", changes)


@pytest.mark.parametrize(
    ("algo", "changes"),
    [
        ("ppo", {"target_kl": None, "learning_rate": "lin_0.001", "ent_coef": 0.0}),
        ("sac", {"gradient_steps": -1, "train_freq": [2, "step"], "ent_coef": "auto_0.1"}),
    ],
)
def test_what_stable_baselines3_writes_is_taken(algo, changes):
    assert learners.learner(algo).settings("scratch", changes).n_timesteps > 0
