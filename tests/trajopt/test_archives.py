"""Archives of arrays: written as a whole, read only if they are what they claim to be."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trajopt.files import ABANDONED, digest, read_arrays, write_arrays


def test_what_is_written_is_read_and_replaces_the_file_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "stamps.npz"
    for value in (1.0, 2.0):
        write_arrays(path, "stamps 3", {"value": value}, {"a": np.full(2, value)})
    header, arrays = read_arrays(path, "stamps 3", ValueError, "draw it again")
    assert header == {"value": 2.0}
    assert arrays["a"].tolist() == [2.0, 2.0]
    assert [file.name for file in tmp_path.iterdir()] == ["stamps.npz"]


def test_what_a_killed_process_left_is_swept_but_not_what_another_writes_now(
    tmp_path: Path,
) -> None:
    left, written = tmp_path / "stamps.npz.1.part", tmp_path / "stamps.npz.2.part"
    for part in (left, written):
        part.write_text("half")
    hours_ago = time.time() - 2.0 * ABANDONED
    os.utime(left, (hours_ago, hours_ago))
    write_arrays(tmp_path / "stamps.npz", "stamps 3", {}, {"a": np.ones(2)})
    assert sorted(file.name for file in tmp_path.iterdir()) == ["stamps.npz", written.name]


def test_a_file_whose_writing_was_interrupted_stays_as_it_was(
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


def test_the_digest_sees_names_types_and_shapes() -> None:
    a = np.arange(4.0)
    different: list[dict[str, np.ndarray]] = [
        *({"a": a}, {"b": a}, {"a": a.reshape(2, 2)}, {"a": a.astype(np.float32)}),
    ]
    assert len({digest(arrays) for arrays in different}) == len(different)
