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

from agents import PRETRAINED
from agents.policy_files import FORMAT, CheckpointError, load_policy, read_record, save_policy
from agents.sb3.vec_env import Sb3VecEnv
from agents.training import read_state
from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, Task
from rimless_gym.envs.control import Control
from rimless_gym.presets import PRESETS
from trajopt.files import DIGEST, HEADER, digest, read_arrays, write_arrays


def observations():
    return np.random.default_rng(0).uniform(-1, 1, (50, 6)).astype(np.float32)


@pytest.fixture
def new_policy(tmp_path, new_learner):
    """Makes the file of a new policy."""

    def make(algo="ppo"):
        learner = new_learner(algo)
        return save_policy(tmp_path / "p.zip", learner.training, learner)

    return make


def with_record(path, target, **changes):
    """The same policy with another record, signed anew."""
    record, weights = read_arrays(path, FORMAT, CheckpointError, "")
    write_arrays(target, FORMAT, record | changes, weights)
    return target


def with_weights(path, target, **changes):
    """The same record with other weights, signed anew; None leaves one out."""
    record, weights = read_arrays(path, FORMAT, CheckpointError, "")
    changed = {name: value for name, value in (weights | changes).items() if value is not None}
    write_arrays(target, FORMAT, record, changed)
    return target


class Trap:
    """An object whose unpickling runs code: it leaves a file behind."""

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
    assert (loaded.algo, loaded.params, loaded.task, loaded.seed) == (
        algo,
        THESIS_PHYSICAL,
        Task(0.4),
        7,
    )
    assert loaded.record["note"] == "x"
    assert {"torch", "stable-baselines3", "numpy"} <= set(loaded.record["versions"])
    assert not list(tmp_path.glob("*.part"))


def test_a_loaded_policy_can_walk_and_go_on_learning(tmp_path, new_policy):
    path = new_policy()
    model = load_policy(path).model
    action, _ = model.predict(model.env.reset(), deterministic=True)
    assert action.shape == (1, 1)


@pytest.mark.parametrize("name", sorted(PRETRAINED))
def test_the_policies_of_the_package_are_found_from_any_folder(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert load_policy(name).params in PRESETS.values()


def test_a_missing_policy_is_named_with_those_of_the_package(tmp_path):
    with pytest.raises(
        CheckpointError, match=r"no such file.*fine_tuned, front, imitation.*rimless train"
    ):
        load_policy(tmp_path / "nowhere.zip")


def trapped(path, mark):
    """A file of plain stable-baselines3 with a trap in its schedule of the learning rate."""
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    data = json.loads(parts["data"])
    data["lr_schedule"] = {":serialized:": b64encode(pickle.dumps(Trap(mark))).decode()}
    with zipfile.ZipFile(path, "w") as new:
        for name, content in (parts | {"data": json.dumps(data).encode()}).items():
            new.writestr(name, content)
    return path


def test_nothing_in_a_file_of_plain_stable_baselines3_is_run_unless_its_author_is_trusted(
    tmp_path, new_learner
):
    new_learner().model.save(tmp_path / "foreign.zip")
    mark = tmp_path / "mark"
    foreign = trapped(tmp_path / "foreign.zip", mark)
    for read in (load_policy, read_record):
        with pytest.raises(CheckpointError, match=r"can run any code.*trust_pickle=True"):
            read(foreign)
    assert not mark.exists()
    load_policy(foreign, trust_pickle=True)
    assert mark.exists()  # the attack is real


def test_a_file_of_plain_stable_baselines3_can_be_trusted(tmp_path, new_learner):
    model = new_learner("sac").model
    model.save(tmp_path / "foreign.zip")
    loaded = load_policy(tmp_path / "foreign.zip", PROTOTYPE, trust_pickle=True)
    x = observations()
    np.testing.assert_array_equal(loaded.act(x), model.predict(x, deterministic=True)[0][:, 0])
    assert (loaded.algo, loaded.params) == ("sac", PROTOTYPE)


def test_such_a_file_from_the_environment_with_commands_is_known_by_its_observations(tmp_path):
    envs = make_vec_env("RimlessWheelSpeed-v0", 2, vec_env_cls=Sb3VecEnv)
    model = PPO("MlpPolicy", envs, device="cpu", n_steps=32)
    model.save(tmp_path / "evening.zip")
    loaded = load_policy(tmp_path / "evening.zip", trust_pickle=True)
    assert loaded.conditions.control == Control(0.04, speeds=(0.3, 0.62))
    seen = envs.reset()
    np.testing.assert_array_equal(
        loaded.act(seen), model.predict(seen, deterministic=True)[0][:, 0]
    )


@pytest.mark.parametrize("name", ["evolution", "imitation"])
def test_observations_of_another_shape_are_refused(name):
    act = load_policy(name).act
    with pytest.raises(ValueError, match=r"shape \(N, 6\), not \(6,\); .*observation\[None\]"):
        act(np.zeros(6, dtype=np.float32))
    with pytest.raises(ValueError, match=r"not \(2, 8\); it was trained where 6 numbers"):
        act(np.zeros((2, 8), dtype=np.float32))


def signed(arrays):
    """An archive with the digest that its arrays should have."""
    file = io.BytesIO()
    np.savez(file, **arrays, **{DIGEST: np.array(digest(arrays))})
    return file.getvalue()


def test_a_policy_that_holds_more_than_arrays_is_refused_even_if_signed(tmp_path, new_policy):
    path = new_policy("ppo")
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files if name != DIGEST}
    file = io.BytesIO()
    np.savez(file, **arrays, **{DIGEST: np.array(digest(arrays | {"policy.x": b"abc"}))})
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("policy.x", b"abc")
    path.write_bytes(file.getvalue())
    with pytest.raises(CheckpointError, match=r"policy\.x.*no arrays"):
        load_policy(path)


@pytest.mark.parametrize("part", ["weights", HEADER, "beside"])
def test_a_pickle_within_a_policy_or_a_state_is_not_run(tmp_path, new_policy, part):
    mark = tmp_path / "mark"
    trap = np.array([Trap(mark)], dtype=object)
    header = np.array(json.dumps({"format": FORMAT}))
    file = io.BytesIO()
    if part == "beside":
        file.write(signed({HEADER: header}))
        with zipfile.ZipFile(file, "a") as archive:
            archive.writestr("replay.pkl", pickle.dumps(Trap(mark)))
            archive.writestr("policy.pth", pickle.dumps(Trap(mark)))
    else:
        np.savez(file, allow_pickle=True, **{HEADER: header, DIGEST: np.array("")} | {part: trap})
    path = tmp_path / "trap.zip"
    path.write_bytes(file.getvalue())
    with pytest.raises(CheckpointError, match=r"trap\.zip"):
        load_policy(path)
    path.write_bytes(pickle.dumps(Trap(mark)))
    with pytest.raises(CheckpointError, match="damaged"):
        load_policy(path)
    with pytest.raises(pickle.UnpicklingError):
        read_state(path)
    assert not mark.exists()


def test_a_policy_cannot_name_a_class_to_be_built(tmp_path, saved):
    bad = with_record(saved, tmp_path / "bad.zip", policy_kwargs={"activation_fn": "os.system"})
    with pytest.raises(CheckpointError, match=r"os\.system"):
        load_policy(bad)


def test_a_file_that_is_not_an_archive_is_refused(tmp_path):
    (tmp_path / "bad.zip").write_bytes(b"not a zip")
    with pytest.raises(CheckpointError, match="damaged"):
        load_policy(tmp_path / "bad.zip")


def test_a_truncated_or_altered_checkpoint_is_refused(tmp_path, new_policy):
    path = new_policy()
    content = bytearray(path.read_bytes())
    (tmp_path / "short.zip").write_bytes(content[: len(content) // 2])
    content[len(content) // 3] ^= 0xFF
    (tmp_path / "altered.zip").write_bytes(content)
    for name in ("short.zip", "altered.zip"):
        with pytest.raises(CheckpointError, match="damaged"):
            load_policy(tmp_path / name)


def test_a_policy_of_another_observation_layout_is_refused(tmp_path, new_policy):
    path = new_policy()
    other = with_record(path, tmp_path / "q.zip", observation_layout=["phi", "theta"])
    with pytest.raises(CheckpointError, match="observes"):
        load_policy(other)


def test_a_policy_of_another_machine_is_refused_unless_asked_for(tmp_path, new_policy):
    path = new_policy()
    with pytest.raises(CheckpointError, match=r"pendulum_mass.*2\.22.*0\.555"):
        load_policy(path, PROTOTYPE)
    assert load_policy(path).params == THESIS_PHYSICAL


def test_a_record_of_another_version_or_with_parts_missing_is_refused(tmp_path, new_policy):
    path = new_policy()
    write_arrays(tmp_path / "v.zip", "rimless-gym policy 99", {}, {})
    with pytest.raises(CheckpointError, match="policy 99"):
        read_record(tmp_path / "v.zip")
    with pytest.raises(CheckpointError, match="incomplete or invalid"):
        load_policy(with_record(path, tmp_path / "m.zip", params={"wheel_mass": -1}))


@pytest.fixture
def saved(tmp_path, new_policy):
    return new_policy()


@pytest.mark.parametrize("text", ["[]", "null", "3", "not JSON", "", "[" * 100_000])
def test_a_record_that_is_not_an_object_is_refused(tmp_path, saved, text):
    arrays = {HEADER: np.array(text)}
    (tmp_path / "bad.zip").write_bytes(signed(arrays))
    for load in (read_record, load_policy):
        with pytest.raises(CheckpointError, match=r"bad\.zip: damaged.*train it again"):
            load(tmp_path / "bad.zip")


@pytest.mark.parametrize(
    "changes",
    [
        {"algo": "td3"},
        {"algo": []},
        {"seed": None},
        {"seed": float("inf")},
        {"params": None},
        {"params": []},
        {"task": None},
        {"task": {"distance_weight": "much"}},
        {"task": {"price": 1.0}},
    ],
)
def test_a_record_with_an_invalid_entry_is_refused(tmp_path, saved, changes):
    bad = with_record(saved, tmp_path / "bad.zip", **changes)
    with pytest.raises(CheckpointError, match=r"bad\.zip: .*incomplete or invalid.*again"):
        load_policy(bad)


@pytest.mark.parametrize(("algo", "other"), [("ppo", "sac"), ("sac", "ppo")])
def test_a_policy_labelled_with_another_algorithm_is_refused(tmp_path, new_policy, algo, other):
    path = new_policy(algo)
    bad = with_record(path, tmp_path / "bad.zip", algo=other)
    with pytest.raises(CheckpointError, match=rf"bad\.zip: its record says {other}.*again"):
        load_policy(bad)


@pytest.mark.parametrize(
    "weight",
    [
        None,
        np.zeros((3, 3), np.float32),
        np.full((128, 6), np.nan, np.float32),
        np.zeros((128, 6), np.int64),
        np.array(["text"]),
    ],
)
def test_weights_that_do_not_fit_are_refused(tmp_path, saved, weight):
    bad = with_weights(saved, tmp_path / "bad.zip", **{"mlp_extractor.policy_net.0.weight": weight})
    with pytest.raises(CheckpointError, match=r"bad\.zip: .*train it again"):
        load_policy(bad)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(CheckpointError, match=r"a folder.*best\.zip"):
        load_policy(tmp_path)
