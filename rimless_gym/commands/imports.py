"""Who imports whom in this repository, read from the files themselves."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import resolve_name
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("rimless_gym", "trajopt", "agents")

#: From the lowest. The commands are in the lowest package, and use all.
LAYERS = (*PACKAGES, "rimless_gym.commands")


@cache
def files(root: Path = ROOT) -> dict[str, Path]:
    """Every module's file, by the module's name."""
    found = {}
    for package in PACKAGES:
        for path in (root / package).rglob("*.py"):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def layer(module: str) -> int:
    """The place in `LAYERS` of what a module belongs to."""
    return max(n for n, name in enumerate(LAYERS) if f"{module}.".startswith(f"{name}."))


@cache
def graph(root: Path = ROOT, *, types: bool) -> dict[str, set[str]]:
    """The modules that each module imports: the file that each name is from.

    Args:
        root: of the repository.
        types: whether imports for types alone count. They also name what packages look up late.
    """
    modules, edges = files(root), {}
    for module, path in modules.items():
        named = {
            name if name in modules else name.rpartition(".")[0]
            for name in _imports(ast.parse(path.read_text()), types, _package(module, path))
        }
        edges[module] = (named & modules.keys()) - {module}
    return edges


def needed(modules: Iterable[str], root: Path = ROOT) -> list[Path]:
    """The files of modules and of all that they import, directly or not."""
    edges, waiting, found = graph(root, types=True), list(modules), set[str]()
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += edges[module]
    return [files(root)[module] for module in sorted(found)]


def _package(module: str, path: Path) -> str:
    """The package in which a module's relative imports begin."""
    return module if path.stem == "__init__" else module.rpartition(".")[0]


def _imports(node: ast.AST, types: bool, package: str) -> Iterator[str]:
    """The names that a file of a package imports, those in functions included."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            source = "." * child.level + (f"{child.module}." if child.module else "")
            yield from (resolve_name(source + alias.name, package) for alias in child.names)
        elif types or not _for_types(child):
            yield from _imports(child, types, package)


def _for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
