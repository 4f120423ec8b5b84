"""What `import rimless_gym` imports, and what it does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import rimless_gym

HEAVY = ("casadi", "jax", "llvmlite", "matplotlib", "numba", "pygame", "scipy", "torch")


def printed(code: str, *flags: str) -> str:
    settings = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, *flags, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=settings)
    return done.stdout


def test_importing_the_package_and_choosing_a_machine_imports_nothing_heavy() -> None:
    code = (
        "import json, sys, rimless_gym;"
        "rimless_gym.preset('PROTOTYPE').replace(slope=0.01);"
        "print(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    )
    assert not set(HEAVY) & set(json.loads(printed(code)))


def test_public_names_can_be_imported_in_any_order() -> None:
    assert len(set(rimless_gym.__all__)) == len(rimless_gym.__all__)
    assert set(rimless_gym.__all__) <= set(dir(rimless_gym))
    code = (
        "import rimless_gym, rimless_gym.reference, rimless_gym.trajectory;"
        "names = rimless_gym.__all__[::-1];"
        "print([getattr(rimless_gym, name).__class__.__name__ for name in names])"
    )
    assert "module" not in printed(code)
    assert callable(rimless_gym.simulate)
    assert rimless_gym.RimlessWheelEnv.__name__ == "RimlessWheelEnv"
    with pytest.raises(AttributeError, match="no attribute 'Wheel'"):
        rimless_gym.Wheel  # noqa: B018


@pytest.mark.slow
def test_nothing_needs_docstrings() -> None:
    code = (
        "import rimless_gym, rimless_gym.envs.speed, agents.cli.main;print(agents.cli.main.usage())"
    )
    assert "rimless COMMAND" in printed(code, "-OO")


def test_the_version_is_the_projects() -> None:
    project = Path(__file__).parents[2] / "pyproject.toml"
    assert rimless_gym.__version__ == tomllib.loads(project.read_text())["project"]["version"]
