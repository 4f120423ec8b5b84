"""The hyperparameter files, which rl-zoo3 reads too."""

import pytest
import yaml
from torch import nn

from agents import learners
from agents.sb3.hard_starts import HardStarts
from agents.sb3.hyperparameters import FOLDER, hyperparameters
from agents.sb3.pacing import Pacing
from agents.sb3.setting_off import SettingOff
from agents.sb3.stepping_back import SteppingBack
from agents.sb3.training_env import Offer, ScaledReward

HELD = "agents.sb3.training_env.HeldActions"
PACED = "agents.sb3.pacing.SelfPacedPrice"
ENTRY = {"n_envs": 2, "n_timesteps": 100, "policy": "MlpPolicy"}


def read(folder, **changes):
    (folder / "ppo.yml").write_text(yaml.safe_dump({"RimlessWheel-v0": ENTRY | changes}))
    return hyperparameters("ppo.yml", False, folder=folder)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.parametrize("imitation", [False, True])
def test_policy_kwargs_are_read_as_rl_zoo3_reads_them(algo, imitation):
    settings = hyperparameters(f"{algo}.yml", imitation)
    text = settings.written["policy_kwargs"]
    assert isinstance(text, str)  # rl-zoo3 evaluates text only, and so knows activations
    assert settings.algorithm["policy_kwargs"] == eval(text, {"nn": nn})
    assert issubclass(settings.algorithm["policy_kwargs"]["activation_fn"], nn.Module)
    assert settings.offer.value(ScaledReward, "scale") == (100.0 if imitation else 1.0)


def test_what_is_trained_in_is_read_as_rl_zoo3_reads_it():
    for algo in ("ppo", "sac"):
        fresh, tuned = (hyperparameters(f"{algo}.yml", imitation) for imitation in (False, True))
        assert (fresh.intervals_per_step, tuned.intervals_per_step, tuned.pacing) == (4, 1, None)
        assert fresh.pacing.first_price == 5.0
        assert not {"callback", "env_wrapper", "vec_env_wrapper"} & set(fresh.algorithm)
    screened = hyperparameters("screened_ppo.yml", False).offer
    layers = {
        SettingOff: {"intervals": 300, "travel": 0.2},
        SteppingBack: {"charge": 0.1},
        ScaledReward: {"scale": 10.0},
    }
    assert screened == Offer(layers, episode_steps=1000)


def test_policy_kwargs_may_nest_plain_values(tmp_path):
    text = "dict(a=dict(b=[1, -2.5], c=None), activation_fn=nn.SiLU, d='x')"
    kwargs = read(tmp_path, policy_kwargs=text).algorithm["policy_kwargs"]
    assert kwargs == {"a": {"b": [1, -2.5], "c": None}, "activation_fn": nn.SiLU, "d": "x"}


@pytest.mark.parametrize(
    "text",
    [
        *("dict(a=open('x'))", "nn.Linear", "__import__('os')", "dict(", "dict(**{'a': 1})"),
        *("dict([('a', 1)])", "dict(activation_fn=tanh)", {"activation_fn": "tanh"}),
    ],
)
def test_other_expressions_in_policy_kwargs_are_refused(tmp_path, text):
    with pytest.raises(ValueError, match=r"policy_kwargs = .*write dict.*nn\.Tanh"):
        read(tmp_path, policy_kwargs=text)


def test_other_wrappers_and_schedules_are_refused(tmp_path):
    for key in ("env_wrapper", "vec_env_wrapper", "callback"):
        with pytest.raises(ValueError, match=rf"{key} = .*'gym\.Other' is not known; list "):
            read(tmp_path, **{key: [{"gym.Other": {}}]})
    assert read(tmp_path, callback=["agents.sb3.pacing.SelfPacedPrice"]).pacing == Pacing()
    with pytest.raises(ValueError, match="learning_rate = 'cos_1': write a number"):
        read(tmp_path, learning_rate="cos_1")
    again = {"agents.sb3.hard_starts.HardStarts": {"share": 0.3}}
    assert read(tmp_path, vec_env_wrapper=[again]).offer.value(HardStarts, "share") == 0.3
    scaled = {"agents.sb3.training_env.ScaledReward": {"scale": 2.0}}
    with pytest.raises(ValueError, match=r"vec_env_wrapper: .* the order must be .*HardStarts'"):
        read(tmp_path, vec_env_wrapper=[scaled, again])
    assert {path.stem for path in FOLDER.glob("*.yml")} == {"ppo", "sac", "screened_ppo"}


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"n_envs": "x"}, TypeError, "n_envs = 'x': must be an integer of at least 1"),
        ({"gamma": "x"}, TypeError, "gamma = 'x': must be a real number"),
        ({"gamma": 1.5}, ValueError, r"gamma = 1\.5: must be at least 0 and at most 1"),
        ({"gae_lambda": -0.1}, ValueError, r"gae_lambda = -0\.1: must be"),
        ({"learning_rate": -1.0}, ValueError, r"learning_rate = -1\.0: must be"),
        ({"batch_size": 7.5}, TypeError, r"batch_size = 7\.5: must be an integer"),
        ({"normalize_advantage": 3}, TypeError, "normalize_advantage = 3: must be True or False"),
        ({"learning_rate": [1]}, TypeError, r"learning_rate = \[1\]: must be a real number"),
        (
            {"learning_rate": "lin_x"},
            ValueError,
            "learning_rate = 'lin_x': write a number, or lin_",
        ),
        ({"vec_env_wrapper": [3]}, ValueError, r"vec_env_wrapper = \[3\]: 3 is not known; list"),
        ({"vec_env_wrapper": {HELD: 3}}, ValueError, r"must be some of \['intervals'\]; write"),
        ({"callback": [{PACED: {"evry": 3}}]}, ValueError, r"must be some of .*'every'.*; write"),
    ],
)
def test_values_of_the_wrong_kind_are_refused_with_what_they_must_be(changes, error, message):
    with pytest.raises(error, match=message):
        learners.learner("ppo").settings("scratch", changes)


def test_some_values_of_an_entry_can_be_changed():
    kind = learners.learner("ppo")
    usual, other = kind.settings("scratch"), kind.settings("scratch", {"gamma": 0.5, "n_envs": 3})
    assert (other.n_envs, other.algorithm["gamma"]) == (3, 0.5)
    assert other.algorithm["n_steps"] == usual.algorithm["n_steps"]
    assert other.written["gamma"] == 0.5  # so that a folder is known by it
    with pytest.raises(ValueError, match="'gama' is not known; choose from"):
        kind.settings("scratch", {"gama": 0.5})
