"""What users get from a package index: the archives, their text, and types that checkers accept."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

#: Of a user: names that are imported in each of the ways in which the packages export them.
SCRIPT = """
import gymnasium as gym

import rimless_gym
from agents import load_policy
from agents.evaluate import Protocol, evaluate
from rimless_gym import BUILDABLE, RimlessWheelEnv, WheelParams, simulate
from trajopt import Solution, periodic_gait


def walk(params: WheelParams, seconds: float = 2.0) -> float:
    gait: Solution = periodic_gait(params, speed=0.62)
    motion = simulate(params, gait.state(0.0), lambda t, x: 0.0, duration=seconds)
    policy = load_policy("evolution")
    walks = evaluate(lambda states, seen: policy.act(seen), params, Protocol(starts=8))
    return gait.cot + walks.cot + float(motion.x[-1, 0])


env = gym.make("RimlessWheel-v0", params={"slope": 0.01})
assert isinstance(env.unwrapped, RimlessWheelEnv)
print(walk(BUILDABLE), rimless_gym.Task().distance_weight, env.unwrapped.params.weight)
"""


def test_versions_agree_and_the_text_for_an_index_has_no_link_that_breaks_there():
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"version = {{{version}}}" in (ROOT / "docs" / "cite.md").read_text()
    assert not re.search(r"\]\((?!https?:)", PROJECT["readme"]["text"])


def test_the_package_runs_as_a_module():
    command = [sys.executable, "-m", "rimless_gym", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"rimless-gym {distribution('rimless-gym').version}\n"


@pytest.mark.slow
def test_the_archives_hold_what_users_and_packagers_need(tmp_path):
    build = "from setuptools import build_meta as b; b.build_sdist({0!r}); b.build_wheel({0!r})"
    folder = tmp_path / "source"
    files = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in files.stdout.splitlines():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    program = [sys.executable, "-c", build.format(str(tmp_path))]
    subprocess.run(program, cwd=folder, capture_output=True, check=True)
    (sdist,), (wheel,) = tmp_path.glob("*.tar.gz"), tmp_path.glob("*.whl")
    with tarfile.open(sdist) as archive:
        source = {name.partition("/")[2] for name in archive.getnames()}
    assert set(files.stdout.splitlines()) - source <= {".gitignore", ".ci/run"}
    with zipfile.ZipFile(wheel) as archive:
        installed = set(archive.namelist())
    packages = ("rimless_gym/", "trajopt/", "agents/")
    assert {name for name in files.stdout.splitlines() if name.startswith(packages)} <= installed
    assert not {name.split("/")[0] for name in installed} & {"tests", "scripts", "docs"}


@pytest.mark.slow
def test_a_strict_type_checker_accepts_what_users_write(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "script.py"]
    paths = {"MYPYPATH": str(ROOT), "MYPY_CACHE_DIR": str(tmp_path / "cache")}
    checked = subprocess.run(
        [*command, "--follow-imports=silent"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | paths,
    )
    assert checked.returncode == 0, checked.stdout
