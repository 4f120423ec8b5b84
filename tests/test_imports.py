"""Who imports whom: packages only those below them, and no file itself by way of others."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter

import pytest

from rimless_gym.commands.imports import graph, layer

GRAPH = graph(types=False)


def test_no_file_imports_itself_by_way_of_others() -> None:
    try:
        TopologicalSorter(GRAPH).prepare()
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
    inside = {m for m in GRAPH if m == upper or m.startswith(f"{upper}.")}
    for module, imported in GRAPH.items():
        if (module == lower or module.startswith(f"{lower}.")) and module not in inside:
            assert not imported & inside, f"{module} imports {imported & inside}"


def test_layers_import_only_those_below_them() -> None:
    for module, imported in GRAPH.items():
        above = [name for name in imported if layer(name) > layer(module)]
        assert not above, f"{module} imports {above}"


def test_relative_imports_count_too() -> None:
    benchmarks = "rimless_gym.commands.benchmarks"
    found = GRAPH[f"{benchmarks}.workers.casadi_cartpole"]
    assert found == {f"{benchmarks}.cartpole", f"{benchmarks}.protocol"}
