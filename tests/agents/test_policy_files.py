"""Policy files hold plain arrays and a record; policies, laws and baselines are known by name."""

import io
import json
import os
import pickle
import zipfile
from base64 import b64encode

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv

from agents import PRETRAINED
from agents.conditions import Conditions
from agents.policy_files import (
    FORMAT,
    CheckpointError,
    TrainingEffort,
    load_policy,
    named_policy,
    read_record,
    save_policy,
)
from agents.rollout import Predictor, at_rest, controller_policy
from agents.sb3.vec_env import Sb3VecEnv
from agents.training import read_state
from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_PHYSICAL, Task
from rimless_gym.envs.arguments import USUAL, Control
from rimless_gym.envs.layout import observe
from rimless_gym.equations import DOUBLE
from rimless_gym.kernel.stepping import MODE, STATE_SIZE
from trajopt.feedback import laws
from trajopt.gaits.library import shipped
from trajopt.store import DIGEST, HEADER, digest, read_arrays, write_arrays

CLONE = PRETRAINED["imitation"]


def observations():
    return np.random.default_rng(0).uniform(-1, 1, (50, 6)).astype(np.float32)


def with_record(target, **changes):
    """The clone with another record, signed anew."""
    record, weights = read_arrays(CLONE, FORMAT, CheckpointError, "")
    write_arrays(target, FORMAT, record | changes, weights)
    return target


def with_weights(target, **changes):
    """The clone with other weights, signed anew; None leaves one out."""
    record, weights = read_arrays(CLONE, FORMAT, CheckpointError, "")
    changed = {name: value for name, value in (weights | changes).items() if value is not None}
    write_arrays(target, FORMAT, record, changed)
    return target


def signed(arrays):
    """An archive with the digest that its arrays should have."""
    file = io.BytesIO()
    np.savez(file, **arrays, **{DIGEST: np.array(digest(arrays))})
    return file.getvalue()


class Trap:
    """An object whose unpickling runs code: it leaves a folder behind."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_a_policy_comes_back_exactly_as_it_was_saved(tmp_path, new_learner, algo):
    learner = new_learner(algo, seed=7, task=Task(0.4))
    path = save_policy(tmp_path / "p.zip", learner.training, learner, note="x")
    loaded = load_policy(path, THESIS_PHYSICAL)
    x = observations()
    np.testing.assert_array_equal(loaded.act(x), learner.act(x))
    saved = (loaded.algo, loaded.params, loaded.task, loaded.seed)
    assert saved == (algo, THESIS_PHYSICAL, Task(0.4), 7)
    assert loaded.record["note"] == "x"
    assert {"torch", "stable-baselines3", "numpy"} <= set(loaded.record["versions"])
    assert [file.name for file in tmp_path.iterdir()] == ["p.zip"]


@pytest.mark.parametrize("name", ["evolution", "imitation"])
def test_observations_of_another_shape_are_refused(name):
    policy = load_policy(name)
    for wrong in ((8,), (2, 8), (1, 2, 6)):
        for seeing in (policy.act, policy.predict):
            with pytest.raises(ValueError, match=r"must have shape \(6,\) or \(N, 6\)"):
                seeing(np.zeros(wrong, dtype=np.float32))


@pytest.mark.parametrize("name", ["evolution", "imitation"])
def test_a_policy_predicts_and_is_evaluated_as_a_model_of_stable_baselines3(name):
    policy, x = load_policy(name), observations()
    actions, state = policy.predict(x)
    assert (actions.shape, actions.dtype, state) == ((50, 1), np.float32, None)
    single, _ = policy.predict(x[7], deterministic=True)
    np.testing.assert_allclose(single, actions[7], atol=1e-6)  # a batch may be summed otherwise
    np.testing.assert_allclose(policy.act(x[7]), policy.act(x)[7], atol=1e-6)
    short = {"max_episode_steps": 40}
    for vec_env_cls in (Sb3VecEnv, DummyVecEnv):
        envs = make_vec_env("RimlessWheel-v0", 2, 5, env_kwargs=short, vec_env_cls=vec_env_cls)
        totals, lengths = evaluate_policy(policy, envs, 4, return_episode_rewards=True)
        assert (len(totals), lengths) == (4, [40] * 4)


def test_a_law_predicts_from_what_is_observed():
    law = laws.holding("lqr", next(gait for gait in shipped() if gait.steps == 1))
    policy = controller_policy(law.params, law)
    states = np.zeros((2, STATE_SIZE))
    states[:, :4], states[1, MODE] = law.data.orbit.states[7], DOUBLE
    predictor = Predictor(policy, Conditions(law.params))
    expected = policy(states, np.zeros((2, 6), np.float32))
    actions, _ = predictor.predict(observe(law.params, states))
    np.testing.assert_allclose(actions[:, 0], expected, atol=1e-4)


def test_nothing_in_a_file_of_plain_stable_baselines3_is_run_unless_its_author_is_trusted(
    tmp_path, new_learner
):
    foreign, mark = tmp_path / "foreign.zip", tmp_path / "mark"
    model = new_learner().model
    model.save(foreign)
    loaded = load_policy(foreign, PROTOTYPE, trust_pickle=True)
    x = observations()
    np.testing.assert_array_equal(loaded.act(x), model.predict(x, deterministic=True)[0][:, 0])
    assert (loaded.algo, loaded.params) == ("ppo", PROTOTYPE)
    with zipfile.ZipFile(foreign) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(parts["data"])
    data["lr_schedule"] = {":serialized:": b64encode(pickle.dumps(Trap(mark))).decode()}
    with zipfile.ZipFile(foreign, "w") as archive:
        for name, content in (parts | {"data": json.dumps(data).encode()}).items():
            archive.writestr(name, content)
    for read in (load_policy, read_record):
        with pytest.raises(CheckpointError, match=r"can run any code.*trust_pickle=True"):
            read(foreign)
    assert not mark.exists()
    load_policy(foreign, trust_pickle=True)
    assert mark.exists()  # the attack is real


def test_a_foreign_file_of_the_environment_with_commands_is_known_by_its_observations(tmp_path):
    envs = make_vec_env("RimlessWheelSpeed-v0", 2, vec_env_cls=Sb3VecEnv)
    model = PPO("MlpPolicy", envs, device="cpu", n_steps=32)
    model.save(tmp_path / "foreign.zip")
    loaded = load_policy(tmp_path / "foreign.zip", trust_pickle=True)
    assert loaded.conditions.control == Control(0.04, speeds=(0.3, 0.62))
    seen = envs.reset()
    expected = model.predict(seen, deterministic=True)[0][:, 0]
    np.testing.assert_array_equal(loaded.act(seen), expected)


@pytest.mark.parametrize("part", ["weights", HEADER, "beside", "whole"])
def test_a_pickle_within_a_policy_is_not_run(tmp_path, part):
    path, mark = tmp_path / "trap.zip", tmp_path / "mark"
    trap, header = np.array([Trap(mark)], dtype=object), np.array(json.dumps({"format": FORMAT}))
    if part == "whole":
        path.write_bytes(pickle.dumps(Trap(mark)))
    elif part == "beside":
        path.write_bytes(signed({HEADER: header}))
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("replay.pkl", pickle.dumps(Trap(mark)))
            archive.writestr("policy.pth", pickle.dumps(Trap(mark)))
    else:
        entries = {HEADER: header, DIGEST: np.array("")} | {part: trap}
        with path.open("wb") as file:
            np.savez(file, allow_pickle=True, **entries)
    with pytest.raises(CheckpointError, match=r"trap\.zip"):
        load_policy(path)
    if part == "whole":
        with pytest.raises(pickle.UnpicklingError):
            read_state(path)
    assert not mark.exists()


def test_a_policy_cannot_name_a_class_to_be_built(tmp_path):
    bad = with_record(tmp_path / "bad.zip", policy_kwargs={"activation_fn": "os.system"})
    with pytest.raises(CheckpointError, match=r"os\.system"):
        load_policy(bad)


def test_missing_foreign_cut_and_altered_files_are_refused(tmp_path):
    content = bytearray(CLONE.read_bytes())
    short = bytes(content[: len(content) // 2])
    content[len(content) // 3] ^= 0xFF
    for name, data in (("text", b"not a zip"), ("short", short), ("altered", bytes(content))):
        (tmp_path / f"{name}.zip").write_bytes(data)
        with pytest.raises(CheckpointError, match="damaged"):
            load_policy(tmp_path / f"{name}.zip")
    write_arrays(tmp_path / "version.zip", "rimless-gym policy 99", {}, {})
    with pytest.raises(CheckpointError, match="policy 99"):
        read_record(tmp_path / "version.zip")
    with pytest.raises(CheckpointError, match=r"no such file.*front, imitation.*rimless train"):
        load_policy(tmp_path / "nowhere.zip")


@pytest.mark.parametrize("text", ["[]", "not JSON", "", "[" * 100_000])
def test_a_record_that_is_not_an_object_is_refused(tmp_path, text):
    (tmp_path / "bad.zip").write_bytes(signed({HEADER: np.array(text)}))
    for load in (read_record, load_policy):
        with pytest.raises(CheckpointError, match=r"bad\.zip: damaged.*train it again"):
            load(tmp_path / "bad.zip")


@pytest.mark.parametrize(
    "changes",
    [
        {"params": None},
        {"task": {"distance_weight": "much"}},
    ],
)
def test_a_record_with_an_invalid_entry_is_refused(tmp_path, changes):
    bad = with_record(tmp_path / "bad.zip", **changes)
    with pytest.raises(CheckpointError, match=r"bad\.zip: .*incomplete or invalid.*again"):
        load_policy(bad)


def test_a_policy_of_another_layout_machine_or_learner_is_refused(tmp_path):
    with pytest.raises(CheckpointError, match="observes"):
        load_policy(with_record(tmp_path / "q.zip", observation_layout=["phi", "theta"]))
    with pytest.raises(CheckpointError, match=r"trained on another machine: .*wheel_mass"):
        load_policy(CLONE, PROTOTYPE)
    with pytest.raises(CheckpointError, match=r"q\.zip: its record says sac.*again"):
        load_policy(with_record(tmp_path / "q.zip", algo="sac"))


def test_a_record_of_larger_networks_than_the_weights_is_refused_before_they_are_built(tmp_path):
    for units in ([10**9], {"pi": [128, 128], "vf": [128, 10**9]}, {"pi": [128, 128, 10**9]}):
        huge = {"policy_kwargs": {"net_arch": units}}
        with pytest.raises(CheckpointError, match=r"net_arch: .* but the weights are of"):
            load_policy(with_record(tmp_path / "huge.zip", **huge))
    many = {"policy_kwargs": {"n_critics": 10**6}}
    with pytest.raises(CheckpointError, match=r"n_critics = 1000000: the weights are of others"):
        load_policy(with_record(tmp_path / "many.zip", **many))


@pytest.mark.parametrize(
    "weight",
    [
        None,
        np.zeros((3, 3), np.float32),
        np.full((128, 6), np.nan, np.float32),
    ],
)
def test_weights_that_do_not_fit_are_refused(tmp_path, weight):
    bad = with_weights(tmp_path / "bad.zip", **{"mlp_extractor.policy_net.0.weight": weight})
    with pytest.raises(CheckpointError, match=r"bad\.zip: .*train it again"):
        load_policy(bad)


# -- policies by name ------------------------------------------------------------------------------


def no_gait(params):
    pytest.fail("no law was named")


def thesis_gait(params):
    return next(gait for gait in shipped() if gait.params == THESIS_PHYSICAL and gait.steps == 1)


def test_a_policy_of_the_package_is_the_one_in_its_file():
    by_name, by_path = (
        named_policy(str(n), no_gait) for n in ("evolution", PRETRAINED["evolution"])
    )
    assert (by_name.name, by_name.params, by_name.gait) == ("evolution", BUILDABLE, None)
    assert by_name.conditions.control == USUAL
    assert by_name.effort == TrainingEffort.of(read_record("evolution")) != TrainingEffort()
    states, seen = at_rest(BUILDABLE)[None], np.full((1, 6), 0.1, np.float32)
    assert np.array_equal(by_name.policy(states, seen), by_path.policy(states, seen))


def test_a_law_holds_the_gait_that_is_found_for_the_machine(monkeypatch):
    def designed(name, gait):
        return lambda states, modes: np.full(len(states), gait.speed)

    monkeypatch.setattr("agents.policy_files.laws.design", designed)  # designing takes long
    asked = []
    law = named_policy("lqr", lambda params: asked.append(params) or thesis_gait(params))
    assert asked == [BUILDABLE]
    assert law.params == law.gait.params == THESIS_PHYSICAL  # that of the gait
    action = law.policy(at_rest(THESIS_PHYSICAL)[None], np.zeros((1, 6), np.float32))
    assert action == pytest.approx(law.gait.speed / THESIS_PHYSICAL.voltage_limit)


def test_a_law_refuses_a_gait_of_another_machine():
    with pytest.raises(ValueError, match="lqr: is to hold a gait of another machine"):
        named_policy("lqr", thesis_gait, PROTOTYPE)
    with pytest.raises(ValueError, match="adaptive: n_legs = 7: must be 5"):
        named_policy("adaptive", thesis_gait, BUILDABLE)  # legs are not identified
