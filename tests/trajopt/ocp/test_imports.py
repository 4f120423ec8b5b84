"""The engine stands on its own, and its folders are floors that import only downwards."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import trajopt.ocp

FOLDER = Path(trajopt.ocp.__file__).parent

#: From bottom to top. A module imports from its own floor and from those below.
FLOORS = (
    *("arrays", "checks", "interrupted"),
    *("pose", "transcribe", "judge", "results", "solving", "search"),
)

#: Above `pose` alone.
TEXTBOOK = "textbook"

#: Modules of trajopt beside the engine that it may use, because they know nothing of it.
BESIDE = tuple(f"trajopt.{name}" for name in ("files", "pool", "processes", "provenance", "store"))

FOREIGN = ("rimless_gym", "numba", "gymnasium", "agents", "trajopt.gaits")


def test_every_module_is_imported_without_the_wheel_numba_and_gymnasium() -> None:
    code = f"""
import importlib, pkgutil, sys
for name in {FOREIGN}:
    sys.modules[name] = None  # importing it raises ImportError
import trajopt.files, trajopt.processes, trajopt.provenance, trajopt.ocp
for module in pkgutil.walk_packages(trajopt.ocp.__path__, "trajopt.ocp."):
    importlib.import_module(module.name)
    print(module.name)
"""
    settings = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=settings
    )
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) == {name for name in modules() if name != "trajopt.ocp"}


def modules() -> dict[str, Path]:
    """Names and files of all modules of the engine."""
    found = {}
    for path in sorted(FOLDER.rglob("*.py")):
        parts = path.relative_to(FOLDER).with_suffix("").parts
        found[".".join(("trajopt.ocp", *parts)).removesuffix(".__init__")] = path
    return found


def imported(path: Path) -> Iterator[str]:
    """What a file imports from trajopt, wherever in the file: in functions and for types too."""
    known = modules()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            module = node.module or ""
            inside = [f"{module}.{alias.name}" for alias in node.names]
            names = [name if name in known else module for name in inside]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "trajopt")


def floor(module: str) -> str:
    return module.removeprefix("trajopt.ocp.").split(".")[0]


MODULES = [name for name in modules() if name != "trajopt.ocp"]


@pytest.mark.parametrize("module", MODULES)
def test_a_module_imports_only_from_its_own_floor_and_below(module: str) -> None:
    own = floor(module)
    below = ("pose", TEXTBOOK) if own == TEXTBOOK else FLOORS[: FLOORS.index(own) + 1]
    for name in imported(modules()[module]):
        assert name in BESIDE or floor(name) in below, f"{module} imports {name}"


def test_no_module_imports_itself_by_way_of_others() -> None:
    graph = {name: set(imported(path)) for name, path in modules().items()}
    left = dict(graph)
    while left:  # take away what imports nothing that is left
        free = [name for name, needs in left.items() if not needs & left.keys()]
        assert free, f"a circle among {sorted(left)}"
        for name in free:
            del left[name]


@pytest.mark.parametrize("module", BESIDE)
def test_what_the_engine_uses_beside_itself_does_not_use_the_engine(module: str) -> None:
    path = FOLDER.parent / f"{module.removeprefix('trajopt.')}.py"
    assert not list(imported(path))
