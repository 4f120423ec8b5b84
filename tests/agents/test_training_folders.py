"""A folder belongs to one training: other trainings, processes and damaged files are refused."""

import dataclasses
import json
import shutil

import pytest

from agents.folder import sole_user
from agents.policy_files import FORMAT as POLICY
from agents.policy_files import CheckpointError
from agents.training_state import StateError, read_state, write_state
from rimless_gym import PROTOTYPE
from tests.agents.runs import QUICK, run, small
from trajopt.files import read_arrays, write_arrays


def test_two_processes_do_not_train_in_one_folder(folder):
    with (
        sole_user(folder),
        pytest.raises(ValueError, match=r"another process is working in .*--out"),
    ):
        run(folder)


def test_a_folder_with_another_training_is_not_touched(folder):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(ValueError, match=r"seed = 0, not 1: go on with the same, or .* --out"):
        run(folder, seed=1)
    with pytest.raises(ValueError, match="params"):
        run(folder, params=PROTOTYPE)
    with pytest.raises(ValueError, match="algo = ppo, not sac"):
        run(folder, "sac")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_policies_without_a_record_of_their_training_are_not_overwritten(folder):
    (folder / "train.json").unlink()
    (folder / "state.npz").unlink()
    before = {name: (folder / name).read_bytes() for name in ("best.zip", "last.zip")}
    for kept in (("best.zip", "last.zip"), ("best.zip",), ("last.zip",)):
        for name, content in before.items():
            (folder / name).unlink(missing_ok=True)
            if name in kept:
                (folder / name).write_bytes(content)
        with pytest.raises(ValueError, match=rf"{' and '.join(kept)} but no train\.json.*--out"):
            run(folder)
        assert all((folder / name).read_bytes() == before[name] for name in kept)


@pytest.mark.parametrize("text", ["", "{", "null", "[]", "\xff", "[" * 100_000])
def test_a_damaged_record_of_a_training_is_named(folder, text):
    (folder / "train.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=r"train\.json: damaged.*cannot go on.*--out"):
        run(folder)


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x80\x04garbage" * 9])
def test_a_damaged_state_is_named_with_the_remedy(folder, content):
    (folder / "state.npz").write_bytes(content)
    with pytest.raises(StateError, match=r"state\.npz: damaged.*delete it.*--out"):
        run(folder)


@pytest.mark.parametrize(
    ("part", "content", "message"),
    [
        ("parameters", "stranger.zip", "parameters are a str"),
        ("counters", {"policy": 3}, "counters.*policy"),
        ("policy_kwargs", 3, "remove .* to train anew"),
        ("policy_kwargs", {"net_arch": "wide"}, "remove .* to train anew"),
    ],
)
def test_a_signed_state_with_other_parts_is_refused(folder, part, content, message):
    state = read_state(folder / "state.npz")
    state["learner"][part] = content
    write_state(folder / "state.npz", state)
    with pytest.raises(StateError, match=message):
        run(folder, timesteps=256)


@pytest.mark.parametrize("name", ["best.zip", "last.zip"])
def test_a_training_whose_policies_are_missing_does_not_go_on(folder, name):
    (folder / name).unlink()
    with pytest.raises(ValueError, match=rf"{name} is missing: put it back, or remove"):
        run(folder)


@pytest.mark.parametrize("name", ["best.zip", "last.zip"])
def test_a_training_whose_policies_are_damaged_does_not_go_on(folder, name):
    (folder / name).write_bytes((folder / name).read_bytes()[:1000])
    with pytest.raises(CheckpointError, match=rf"{name}: .*damaged"):
        run(folder, timesteps=256)


def test_a_training_that_differs_in_one_hyperparameter_is_refused_by_it(folder):
    settings = small("ppo")
    other = settings.written | {"gamma": 0.5}
    with pytest.raises(ValueError, match=r"= \{'gamma': 0\.99\}, not \{'gamma': 0\.5\}: go on"):
        run(folder, timesteps=256, settings=dataclasses.replace(settings, entry=other))


def test_a_state_of_another_training_is_refused(folder, tmp_path):
    run(tmp_path / "other", seed=1, timesteps=128)
    shutil.copyfile(tmp_path / "other" / "state.npz", folder / "state.npz")
    with pytest.raises(StateError, match=r"state\.npz: .*of another training"):
        run(folder, timesteps=256)


@pytest.mark.parametrize(
    "standing", [{"best": "high"}, {"due": "soon"}, {"logged": [1]}, {"much": 1}, 3]
)
def test_a_signed_state_of_the_wrong_kind_is_named(folder, standing):
    state = read_state(folder / "state.npz")
    write_state(folder / "state.npz", state | {"standing": standing})
    with pytest.raises(StateError, match=r"state\.npz: .*remove .* to train anew"):
        run(folder, timesteps=256)


def test_the_policy_that_a_training_starts_from_is_identified_by_its_weights(tmp_path, swing):
    first = run(tmp_path / "a", init="imitation", expert=swing, cloning=QUICK, timesteps=0)
    run(tmp_path / "b", init=first.clone, timesteps=0)
    record, arrays = read_arrays(first.clone, POLICY, ValueError, "")
    write_arrays(tmp_path / "c.zip", POLICY, record | {"git_revision": "another"}, arrays)
    run(tmp_path / "b", init=tmp_path / "c.zip", timesteps=0)
    with pytest.raises(ValueError, match="with init = ppo policy"):
        run(tmp_path / "b", timesteps=0)


def test_a_record_with_an_entry_missing_counts_as_another_training(folder):
    notes = json.loads((folder / "train.json").read_text())
    del notes["task"]
    (folder / "train.json").write_text(json.dumps(notes))
    with pytest.raises(ValueError, match="task = None"):
        run(folder)


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("precious")
    with pytest.raises(ValueError, match=r"is a file: choose a folder"):
        run(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "precious"
