"""Finished work in files: complete or not there, and only what it claims to be."""

from __future__ import annotations

import dataclasses
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trajopt.store import ABANDONED, Store, digest, key, read_arrays, write_arrays


def test_a_result_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    store = Store(tmp_path)
    value = {"cot": 0.1 + 0.2, "none": float("inf"), "walks": [{"times": np.arange(3.0)}, "why"]}
    store.save("seed1/ppo", value)
    loaded = Store(tmp_path).load("seed1/ppo")
    assert loaded["walks"][0].pop("times").tolist() == [0.0, 1.0, 2.0]
    assert loaded == {"cot": 0.1 + 0.2, "none": float("inf"), "walks": [{}, "why"]}
    store.save("seed1/ppo", np.float64(2.0))
    assert Store(tmp_path).load("seed1/ppo") == 2.0


def test_a_result_counts_only_while_it_and_its_files_are_unchanged(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert "ppo" not in store
    (tmp_path / "best.zip").write_text("weights")
    for changed, how in (("ppo.json", "value"), ("ppo.npz", ""), ("best.zip", "weights")):
        store.save("ppo", {"value": np.ones(2)}, files=["best.zip"])
        assert "ppo" in store
        path = tmp_path / changed
        before = path.read_bytes()
        path.write_bytes(before.replace(how.encode(), b"other") if how else before[:-9])
        assert "ppo" not in store
        with pytest.raises(KeyError, match="changed"):
            store.load("ppo")
        path.write_bytes(before)


def test_a_folder_holds_results_of_the_same_inputs_and_one_process_works_in_it(
    tmp_path: Path,
) -> None:
    with Store(tmp_path / "out", {"params": {"mass": 1.0, "legs": 8}}) as store:
        store.save("a", 1)
        with pytest.raises(ValueError, match="another process"), Store(tmp_path / "out"):
            pass
    with Store(tmp_path / "out", {"params": {"mass": 1.0, "legs": 8}}) as store:
        assert "a" in store
    other = Store(tmp_path / "out", {"params": {"mass": 2.0, "legs": 8}})
    with pytest.raises(ValueError, match=r"params = \{'mass': 1.0\}, not \{'mass': 2.0\}"), other:
        pass


@dataclasses.dataclass(frozen=True)
class Gait:
    speed: float


def test_a_key_depends_on_every_input() -> None:
    keys = {
        key("lqr, 0.5 m/s", gait=Gait(0.5), sizes=[1, 2]),
        key("lqr, 0.5 m/s", gait=Gait(0.6), sizes=[1, 2]),
        key("lqr, 0.5 m/s", gait=Gait(0.5), sizes=np.array([1, 3])),
        key("tvlqr", gait=Gait(0.5), sizes=[1, 2]),
    }
    assert len(keys) == 4
    assert all(each == Path(each).name and " " not in each for each in keys)
    assert key("a", x=(1, 2), y=None) == key("a", y=None, x=np.array([1, 2]))


STEPS = """
import sys, time
from trajopt.store import Store
with Store(sys.argv[1], {"seed": 0}) as store:
    for task in range(5):
        if str(task) not in store:
            store.save(str(task), task**2)
            print(task, flush=True)
            time.sleep(float(sys.argv[2]))
"""


def test_a_killed_process_goes_on_where_it_ended(tmp_path: Path) -> None:
    command = [sys.executable, "-c", STEPS, str(tmp_path)]
    with subprocess.Popen([*command, "600"], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "0\n"
        first.send_signal(signal.SIGKILL)
    second = subprocess.run([*command, "0"], capture_output=True, text=True, check=True)
    assert second.stdout.split() == ["1", "2", "3", "4"]
    assert [Store(tmp_path).load(str(task)) for task in range(5)] == [0, 1, 4, 9, 16]


def test_arrays_replace_a_file_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "stamps.npz"
    for value in (1.0, 2.0):
        write_arrays(path, "stamps 3", {"value": value}, {"a": np.full(2, value)})
    header, arrays = read_arrays(path, "stamps 3", ValueError, "draw it again")
    assert (header, arrays["a"].tolist()) == ({"value": 2.0}, [2.0, 2.0])
    assert [file.name for file in tmp_path.iterdir()] == ["stamps.npz"]
    with pytest.raises(ValueError, match=r"'stamps 3', but 'stamps 4'.*draw it again"):
        read_arrays(path, "stamps 4", ValueError, "draw it again")


def test_arrays_that_would_take_too_much_memory_are_refused_before_they_are_read(
    tmp_path: Path,
) -> None:
    path = tmp_path / "stamps.npz"
    write_arrays(path, "stamps 3", {}, {"a": np.zeros(2**20)})
    assert path.stat().st_size < 2**14
    tracemalloc.start()
    with pytest.raises(ValueError, match="bytes of arrays, and at most 4194304 are read"):
        read_arrays(path, "stamps 3", ValueError, "draw it again", most=2**22)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()


def test_arrays_that_were_edited_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "stamps.npz"
    write_arrays(path, "stamps 3", {}, {"year": np.array([1840.0])})
    with np.load(path) as data:
        entries = {name: data[name] for name in data.files}
    np.savez(path, **{**entries, "year": np.array([1841.0])})
    with pytest.raises(ValueError, match="wrong digest"):
        read_arrays(path, "stamps 3", ValueError, "draw it again")


def test_unfinished_files_of_killed_processes_are_removed_but_not_recent_ones(
    tmp_path: Path,
) -> None:
    abandoned, recent = tmp_path / "stamps.npz.1.part", tmp_path / "stamps.npz.2.part"
    for part in (abandoned, recent):
        part.write_text("half")
    hours_ago = time.time() - 2.0 * ABANDONED
    os.utime(abandoned, (hours_ago, hours_ago))
    write_arrays(tmp_path / "stamps.npz", "stamps 3", {}, {"a": np.ones(2)})
    assert sorted(file.name for file in tmp_path.iterdir()) == ["stamps.npz", recent.name]


def test_an_interrupted_write_leaves_the_file_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(file: Any, **arrays: Any) -> None:
        file.write(b"half")
        raise KeyboardInterrupt

    path = tmp_path / "stamps.npz"
    write_arrays(path, "stamps 3", {}, {"a": np.ones(2)})
    before = path.read_bytes()
    monkeypatch.setattr(np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_arrays(path, "stamps 3", {}, {"a": np.zeros(2)})
    assert [file.name for file in tmp_path.iterdir()] == ["stamps.npz"]
    assert path.read_bytes() == before


def test_the_digest_depends_on_names_types_and_shapes() -> None:
    a = np.arange(4.0)
    different: list[dict[str, np.ndarray]] = [
        *({"a": a}, {"b": a}, {"a": a.reshape(2, 2)}, {"a": a.astype(np.float32)}),
    ]
    assert len({digest(arrays) for arrays in different}) == len(different)


WRITE = """
import sys
from pathlib import Path
from trajopt.store import write_text
for k in range(100):
    write_text(Path(sys.argv[1]), sys.argv[2])
"""


def test_processes_may_write_the_same_file_at_the_same_time(tmp_path: Path) -> None:
    path = tmp_path / "gait.txt"
    texts = ["one\n" * 50, "two\n" * 50]
    command = [sys.executable, "-c", WRITE, str(path)]
    writing = [subprocess.Popen([*command, text], stderr=subprocess.PIPE) for text in texts]
    assert [each.communicate()[1].decode() for each in writing] == ["", ""]
    assert path.read_text() in texts
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_result_whose_file_is_missing_and_inputs_that_are_fewer_are_refused(
    tmp_path: Path,
) -> None:
    with Store(tmp_path, {"seed": 1, "steps": 2}) as store:
        with pytest.raises(FileNotFoundError, match=r"no file gait\.npz"):
            store.save("task", 1, files=["gait.npz"])
        assert "task" not in store
    with pytest.raises(ValueError, match="results of steps = 2, not None"):
        Store(tmp_path, {"seed": 1}).__enter__()


def test_an_input_may_have_any_name_and_results_of_unknown_inputs_are_refused(
    tmp_path: Path,
) -> None:
    with Store(tmp_path, {"versions": 1, "git_revision": "a"}) as store:
        store.save("task", 1)
    with pytest.raises(ValueError, match="results of versions = 1, not 2"):
        Store(tmp_path, {"versions": 2, "git_revision": "a"}).__enter__()
    (tmp_path / "inputs.json").unlink()
    with pytest.raises(ValueError, match=r"results but no inputs\.json"):
        Store(tmp_path, {"versions": 1, "git_revision": "a"}).__enter__()


def test_a_store_in_use_reaches_workers_that_have_its_folder(tmp_path: Path) -> None:
    with Store(tmp_path / "here", {"seed": 1}) as store:
        store.save("a", 1)
        sent = pickle.dumps(store)
    assert pickle.loads(sent).load("a") == 1
    shutil.rmtree(tmp_path / "here")
    with pytest.raises(FileNotFoundError, match="that all workers share"):
        pickle.loads(sent)
