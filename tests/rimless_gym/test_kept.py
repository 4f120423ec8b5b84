"""Machine code on disk: one process compiles, others load, and nothing stale or damaged is run."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numba
import pytest

from rimless_gym import kept as keeping
from rimless_gym.jit import cached

PACKAGE = Path(keeping.__file__).parent

#: Waits for a signal, calls a function, and prints how often it was compiled.
PROGRAM = """
import pathlib, sys, time
from rimless_gym import THESIS_PHYSICAL
from rimless_gym.reference import guards
ready, begin = (pathlib.Path(name) for name in sys.argv[1:])
ready.touch()
while not begin.exists():
    time.sleep(0.001)
guards(0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0, THESIS_PHYSICAL.constants_array)
print(sum(guards.stats.cache_misses.values()))
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
def test_when_processes_start_together_one_compiles_and_says_so(tmp_path: Path) -> None:
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


def test_without_a_writable_folder_it_runs_and_prints_one_line_with_the_remedy(
    tmp_path: Path,
) -> None:
    shutil.copytree(PACKAGE, tmp_path / "rimless_gym", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [tmp_path / "rimless_gym", *(tmp_path / "rimless_gym").rglob("*/")]:
        (folder / "__pycache__").touch()  # a file: not even root can make a folder of that name
    (tmp_path / "begin").touch()
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"), "/dev/null")
    places = os.pathsep.join([str(tmp_path), *sys.path])
    process = started(tmp_path, "ready", PYTHONPATH=places, NUMBA_CACHE_DIR="", **nowhere)
    out, complaints = process.communicate(timeout=60)
    assert int(out) == 1
    [line] = complaints.splitlines()
    assert "NUMBA_CACHE_DIR" in line


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for machine code during a test."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return tmp_path


def double(x: float) -> float:
    return 2 * x


def compiled() -> tuple[int, list[Path]]:
    """Call `double` once: how often it was compiled, and the files afterwards."""
    function: Any = kept()(double)
    assert function(3) == 6
    return sum(function.stats.cache_misses.values()), files()


def files() -> list[Path]:
    return sorted(Path(numba.config.CACHE_DIR).rglob("*.nbc"))


def test_a_function_is_compiled_once_and_then_loaded(folder: Path) -> None:
    assert compiled()[0] == 1
    assert compiled()[0] == 0


@pytest.mark.parametrize("size", [0, 20, 5000])
def test_a_damaged_file_is_compiled_again(folder: Path, size: int) -> None:
    [file] = compiled()[1]
    whole = file.read_bytes()
    file.write_bytes(whole[:size] + bytes(len(whole) - size) if size == 5000 else whole[:size])
    assert compiled()[0] == 1
    assert compiled()[0] == 0


@pytest.mark.parametrize(
    ("name", "value"), [("SOURCE_FINGERPRINT", 1), ("package_fingerprint", lambda package: 1)]
)
def test_code_compiled_from_other_sources_is_replaced(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: Any
) -> None:
    _, [before] = compiled()
    monkeypatch.setattr(keeping, name, value)
    times, after = compiled()
    assert times == 1
    assert len(after) == 1
    assert after != [before]


def test_the_fingerprint_counts_all_sources_but_those_of_the_commands(tmp_path: Path) -> None:
    def fingerprint() -> int:
        return int(runpy.run_path(str(tmp_path / "fingerprint.py"))["SOURCE_FINGERPRINT"])

    shutil.copy(PACKAGE / "fingerprint.py", tmp_path)
    for name in ("commands", "kernel"):
        (tmp_path / name).mkdir()
    first = fingerprint()
    (tmp_path / "commands" / "train.py").write_text("1\n")
    assert fingerprint() == first
    (tmp_path / "kernel" / "step.py").write_text("1\n")
    assert fingerprint() != first


def test_a_file_that_cannot_be_written_costs_only_a_warning(folder: Path) -> None:
    _, [file] = compiled()
    file.unlink()
    file.mkdir()  # so that the file cannot be written
    with pytest.warns(RuntimeWarning, match="cannot be kept in .*NUMBA_CACHE_DIR"):
        assert compiled()[0] == 1
    assert files() == [file]  # no unfinished file is left


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners here")
def test_machine_code_that_others_may_have_written_is_not_loaded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, [file] = compiled()
    file.chmod(0o666)
    assert compiled()[0] == 1  # which writes the file again
    assert compiled()[0] == 0
    if os.getuid() == 0:
        os.chown(file, 65534, -1)
    else:
        monkeypatch.setattr(os, "getuid", lambda: 65534)
    assert compiled()[0] == 1
