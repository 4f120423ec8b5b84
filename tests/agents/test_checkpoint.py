import json
import zipfile

import numpy as np
import pytest
from stable_baselines3 import A2C

from agents.checkpoint import (
    RECORD,
    CheckpointError,
    load_checkpoint,
    read_record,
    save_checkpoint,
)
from agents.policies import model_policy
from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, Task


def observations():
    return np.random.default_rng(0).uniform(-1, 1, (50, 6)).astype(np.float32)


def with_parts(path, target, **changes):
    """The same checkpoint with other parts; None leaves one out."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = changes.get(name, old.read(name))
            if content is not None:
                new.writestr(name, content)
    return target


def with_record(path, target, **changes):
    """The same checkpoint with another record."""
    return with_parts(path, target, **{RECORD: json.dumps(read_record(path) | changes).encode()})


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_a_policy_comes_back_exactly_as_it_was_saved(tmp_path, new_model, algo):
    model = new_model(algo)
    path = save_checkpoint(tmp_path / "p.zip", model, THESIS_PHYSICAL, Task(0.4), 7, note="x")
    loaded = load_checkpoint(path, THESIS_PHYSICAL)
    x = observations()
    np.testing.assert_array_equal(model_policy(loaded.model)(x, x), model_policy(model)(x, x))
    assert (loaded.algo, loaded.params, loaded.task, loaded.seed) == (
        algo,
        THESIS_PHYSICAL,
        Task(0.4),
        7,
    )
    assert loaded.record["note"] == "x"
    assert {"torch", "stable-baselines3", "numpy"} <= set(loaded.record["versions"])
    assert not list(tmp_path.glob("*.part"))


def test_a_missing_checkpoint_is_named(tmp_path):
    with pytest.raises(CheckpointError, match=r"no such file.*train\.py"):
        load_checkpoint(tmp_path / "nowhere.zip")


def test_a_stable_baselines3_model_of_other_origin_is_refused(tmp_path, new_model):
    new_model().save(tmp_path / "foreign.zip")
    with pytest.raises(CheckpointError, match=f"no {RECORD}"):
        load_checkpoint(tmp_path / "foreign.zip")


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    (tmp_path / "bad.zip").write_bytes(b"not a zip")
    with pytest.raises(CheckpointError, match="damaged"):
        load_checkpoint(tmp_path / "bad.zip")


def test_a_truncated_or_altered_checkpoint_is_refused(tmp_path, new_model):
    path = save_checkpoint(tmp_path / "p.zip", new_model(), THESIS_PHYSICAL, Task(), 0)
    content = bytearray(path.read_bytes())
    (tmp_path / "short.zip").write_bytes(content[: len(content) // 2])
    content[len(content) // 3] ^= 0xFF
    (tmp_path / "altered.zip").write_bytes(content)
    for name in ("short.zip", "altered.zip"):
        with pytest.raises(CheckpointError, match="damaged"):
            load_checkpoint(tmp_path / name)


def test_a_policy_of_another_observation_layout_is_refused(tmp_path, new_model):
    path = save_checkpoint(tmp_path / "p.zip", new_model(), THESIS_PHYSICAL, Task(), 0)
    other = with_record(path, tmp_path / "q.zip", observation_layout=["phi", "theta"])
    with pytest.raises(CheckpointError, match="observes"):
        load_checkpoint(other)


def test_a_policy_of_another_machine_is_refused_unless_asked_for(tmp_path, new_model):
    path = save_checkpoint(tmp_path / "p.zip", new_model(), THESIS_PHYSICAL, Task(), 0)
    with pytest.raises(CheckpointError, match=r"pendulum_mass.*2\.22.*0\.555"):
        load_checkpoint(path, PROTOTYPE)
    assert load_checkpoint(path).params == THESIS_PHYSICAL


def test_a_record_of_another_version_or_with_parts_missing_is_refused(tmp_path, new_model):
    path = save_checkpoint(tmp_path / "p.zip", new_model(), THESIS_PHYSICAL, Task(), 0)
    with pytest.raises(CheckpointError, match="version 99"):
        read_record(with_record(path, tmp_path / "v.zip", format_version=99))
    with pytest.raises(CheckpointError, match="incomplete or invalid"):
        load_checkpoint(with_record(path, tmp_path / "m.zip", params={"wheel_mass": -1}))


@pytest.fixture
def saved(tmp_path, new_model):
    return save_checkpoint(tmp_path / "p.zip", new_model(), THESIS_PHYSICAL, Task(), 0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"[]", "holds list"),
        (b"null", "holds NoneType"),
        (b"3", "holds int"),
        (b"not JSON", "damaged"),
        (b"", "damaged"),
        (b"\xff\xfe\xff", "damaged"),
        (b"[" * 100_000, "damaged"),
    ],
)
def test_a_record_that_is_no_object_is_refused(tmp_path, saved, text, message):
    bad = with_parts(saved, tmp_path / "bad.zip", **{RECORD: text})
    for load in (read_record, load_checkpoint):
        with pytest.raises(CheckpointError, match=rf"bad\.zip: .*{message}.*train it again"):
            load(bad)


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
        {"task": {"value_of_distance": "much"}},
        {"task": {"price": 1.0}},
    ],
)
def test_a_record_with_an_invalid_entry_is_refused(tmp_path, saved, changes):
    bad = with_record(saved, tmp_path / "bad.zip", **changes)
    with pytest.raises(CheckpointError, match=r"bad\.zip: .*incomplete or invalid.*again"):
        load_checkpoint(bad)


@pytest.mark.parametrize(("algo", "other"), [("ppo", "sac"), ("sac", "ppo")])
def test_a_relabelled_algorithm_is_refused(tmp_path, new_model, algo, other):
    path = save_checkpoint(tmp_path / "p.zip", new_model(algo), THESIS_PHYSICAL, Task(), 0)
    bad = with_record(path, tmp_path / "bad.zip", algo=other)
    with pytest.raises(CheckpointError, match=rf"bad\.zip: its record says {other}.*again"):
        load_checkpoint(bad)


@pytest.mark.parametrize("part", ["data", "policy.pth"])
def test_a_model_with_parts_missing_is_refused(tmp_path, saved, part):
    bad = with_parts(saved, tmp_path / "bad.zip", **{part: None})
    with pytest.raises(CheckpointError, match=rf"bad\.zip: damaged: no {part} in it.*again"):
        load_checkpoint(bad)


@pytest.mark.parametrize("part", ["data", "policy.pth", "policy.optimizer.pth"])
@pytest.mark.parametrize("content", [b"", b"{}", b"[]", b"garbage", b"\x80\x04garbage" * 9])
def test_a_model_with_garbage_inside_is_refused(tmp_path, saved, part, content):
    bad = with_parts(saved, tmp_path / "bad.zip", **{part: content})
    with pytest.raises(CheckpointError, match=r"bad\.zip: .*no ppo policy can be read.*again"):
        load_checkpoint(bad)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(CheckpointError, match=r"a folder.*best\.zip"):
        load_checkpoint(tmp_path)


def test_only_ppo_and_sac_are_saved(tmp_path):
    with pytest.raises(CheckpointError, match="A2C"):
        save_checkpoint(
            tmp_path / "p.zip", A2C("MlpPolicy", "Pendulum-v1"), THESIS_PHYSICAL, Task(), 0
        )
