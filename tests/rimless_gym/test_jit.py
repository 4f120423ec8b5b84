"""Machine code on disk: one process compiles, others load, and nothing stale or damaged is run."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numba
import pytest

from rimless_gym import jit
from rimless_gym.jit import cached

#: Waits for a signal, calls a function, and prints how often it was compiled.
PROGRAM = """
import pathlib, sys, time
from rimless_gym import THESIS_PHYSICAL
from rimless_gym.reference import guard_values
ready, begin = (pathlib.Path(name) for name in sys.argv[1:])
ready.touch()
while not begin.exists():
    time.sleep(0.001)
guard_values(0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0, THESIS_PHYSICAL.constants_array)
print(sum(guard_values.stats.cache_misses.values()))
"""


def started(folder: Path, name: str, **environment: str) -> subprocess.Popen[str]:
    settings = {"PYTHONPATH": os.pathsep.join(sys.path)} | environment
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder / name), str(folder / "begin")],
        env=os.environ | settings,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_when_processes_start_together_one_compiles_and_announces_it(tmp_path: Path) -> None:
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    names = [f"process-{k}" for k in range(4)]
    processes = [started(tmp_path, name, **cache) for name in names]
    deadline = time.monotonic() + 60
    while not all((tmp_path / name).exists() for name in names):
        assert time.monotonic() < deadline
        time.sleep(0.001)
    (tmp_path / "begin").touch()
    outputs = [process.communicate(timeout=60) for process in processes]
    assert sorted(int(out) for out, _ in outputs) == [0, 0, 0, 1]
    for out, complaints in outputs:
        lines = complaints.splitlines()
        assert len(lines) == int(out)
        assert all("compiling the reference simulator (about" in line for line in lines)
    out, complaints = started(tmp_path, "later", **cache).communicate(timeout=60)
    assert (out, complaints) == ("0\n", "")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for machine code during a test."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return tmp_path


def double(x: float) -> float:
    return 2 * x


def compiled() -> tuple[int, list[Path]]:
    """Call `double` once: how often it was compiled, and the files afterwards."""
    function: Any = cached()(double)
    assert function(3) == 6
    return sum(function.stats.cache_misses.values()), files()


def files() -> list[Path]:
    return sorted(Path(numba.config.CACHE_DIR).rglob("*.nb[ic]"))


def test_a_function_is_compiled_once_and_then_loaded_unless_its_file_is_damaged(
    folder: Path,
) -> None:
    times, stored = compiled()
    assert times == 1
    assert compiled()[0] == 0
    for file in stored:
        for size in (0, file.stat().st_size // 2):
            file.write_bytes(file.read_bytes()[:size])
            assert compiled()[0] == 1
            assert compiled()[0] == 0


def test_code_compiled_from_other_sources_is_replaced(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, before = compiled()
    monkeypatch.setattr(jit, "fingerprint", lambda package: "other")
    times, after = compiled()
    assert times == 1
    assert len(after) == len(before)
    assert not set(after) & set(before)


def test_without_compiling_there_is_no_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    with pytest.raises(ValueError, match=r"NUMBA_DISABLE_JIT is set: .* unset it"):
        importlib.reload(jit)


def test_a_file_that_cannot_be_written_costs_only_a_warning(folder: Path) -> None:
    _, stored = compiled()
    for file in stored:
        file.unlink()
    stored[0].mkdir()  # so that the file cannot be written
    with pytest.warns(RuntimeWarning, match=r"cannot be stored in .*NUMBA_CACHE_DIR"):
        assert compiled()[0] == 1
    assert set(files()) <= set(stored)  # no unfinished file is left


def test_without_a_writable_folder_functions_are_compiled_in_every_process(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*arguments: Any) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(jit.FunctionCache, "__init__", refused)
    function: Any = cached()(double)
    with pytest.warns(RuntimeWarning, match=r"no folder is writable; set NUMBA_CACHE_DIR"):
        assert function(3) == 6
    assert files() == []
