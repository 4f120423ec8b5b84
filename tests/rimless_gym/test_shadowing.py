"""What is said where another package has the name of one of ours."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rimless_gym.shadowing import PACKAGES, require_ours

ROOT = Path(__file__).parents[2]


def run(*path: Path, words: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    """The command and words after it, with folders before everything else on the path."""
    settings = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [*path, ROOT]))}
    code = "from agents.cli.command import main; exit(main())"
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(
        command, env=settings, capture_output=True, text=True, check=False, cwd="/"
    )


@pytest.mark.parametrize("name", PACKAGES)
def test_the_command_says_what_hides_a_package_of_ours_and_the_remedy(name, tmp_path):
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text('"""Something else."""\nraise SystemExit(9)\n')
    done = run(tmp_path, words=("gait", "--help"))
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f"another package called {name!r} hides that of rimless-gym" in line
    assert str(tmp_path / name / "__init__.py") in line
    assert "virtual environment of its own" in line


def test_the_distribution_that_hides_it_is_named(tmp_path):
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "__init__.py").write_text("")
    about = tmp_path / "openai_agents-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: openai-agents\nVersion: 1.0\n")
    (about / "top_level.txt").write_text("agents\n")
    assert "(of openai-agents)" in run(tmp_path, words=("gait",)).stderr


def test_where_nothing_hides_them_the_command_runs():
    require_ours()
    done = run()
    assert done.returncode == 0, done.stderr
    assert "usage: rimless COMMAND" in done.stdout


def test_a_package_called_scripts_which_others_ship_too_is_no_matter(tmp_path):
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "__init__.py").write_text("raise SystemExit(9)\n")
    for words, told in ((), "usage: rimless COMMAND"), (("gait", "--help"), "usage: rimless gait"):
        done = run(tmp_path, words=words)
        assert done.returncode == 0, done.stderr
        assert told in done.stdout


def test_the_installed_command_is_the_one_that_checks():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["scripts"] == {"rimless": "agents.cli.command:main"}


def test_what_is_installed_has_no_package_scripts():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    found = project["tool"]["setuptools"]["packages"]["find"]["include"]
    assert found == ["rimless_gym*", "trajopt*", "agents*"]
