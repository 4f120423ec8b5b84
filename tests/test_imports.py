"""Who imports whom: packages only those below them, and no file itself by way of others."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rimless_gym", "trajopt", "agents", "scripts")  # from the lowest


def files() -> dict[str, Path]:
    """Every module's file, by the module's name."""
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def typing_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def imports(node: ast.AST) -> Iterator[str]:
    """The names that a file imports, those in functions included; not those for types alone."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom) and child.module:
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        elif not typing_only(child):
            yield from imports(child)


@cache
def graph() -> dict[str, set[str]]:
    """The modules that each module imports: the file that each name is from."""
    modules, edges = files(), {}
    for module, path in modules.items():
        named = {
            name if name in modules else name.rpartition(".")[0]
            for name in imports(ast.parse(path.read_text()))
        }
        edges[module] = (named & modules.keys()) - {module}
    return edges


def test_no_file_imports_itself_by_way_of_others() -> None:
    try:
        TopologicalSorter(graph()).prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' <- '.join(error.args[1])}")


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        ("rimless_gym.kernel", "rimless_gym.envs"),
        ("rimless_gym.envs", "rimless_gym.reference"),
        ("trajopt.ocp", "rimless_gym"),
        ("trajopt.ocp", "trajopt.gaits"),
        ("trajopt.gaits", "trajopt.feedback"),
        ("agents", "agents.comparison"),
    ],
)
def test_what_is_built_on_does_not_import_what_is_built_on_it(lower: str, upper: str) -> None:
    inside = {m for m in graph() if m == upper or m.startswith(f"{upper}.")}
    for module, imported in graph().items():
        if (module == lower or module.startswith(f"{lower}.")) and module not in inside:
            assert not imported & inside, f"{module} imports {imported & inside}"


def test_packages_import_only_those_below_them() -> None:
    for module, imported in graph().items():
        rank = PACKAGES.index(module.partition(".")[0])
        above = [name for name in imported if PACKAGES.index(name.partition(".")[0]) > rank]
        assert not above, f"{module} imports {above}"
