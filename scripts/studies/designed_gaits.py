"""Searches of gaits in stages that are stored; starts of machines that are designed with gaits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from trajopt import pool
from trajopt.gaits.problem import CONTROL_DEGREE
from trajopt.gaits.solution import Solution
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome
from trajopt.ocp.problem import Problem
from trajopt.ocp.solve import solve
from trajopt.store import Store, jsonable

#: Meshes (elements, degree): of the search, and the first one of the refined gait.
SEARCH_MESH, FIRST_MESH = (20, 5), (24, 7)

#: Tolerances of the refined mesh. A whirling pendulum makes the errors of a step large.
MESH_ERROR, HAMILTONIAN = 1e-9, 1e-1

#: Optima that are refined until one is verified, and by how much (relative) a gait must cost less
#: than the one that it replaces.
REFINED, WORTH_IT = 2, 1e-3


def stage(
    store: Store,
    name: str,
    tasks: Mapping[str, tuple[Any, ...]],
    work: Callable[..., Any],
    workers: int | None = None,
) -> dict[str, Any]:
    """Results of `work` (gaits, or JSON values) for every task; those in the store are read.

    The name of the stage is its folder's; `tasks` has the arguments of `work` by result.
    """
    left = [
        (f"{name}/{key}", work, arguments)
        for key, arguments in tasks.items()
        if f"{name}/{key}" not in store
    ]
    for (key, *_), result in pool.run(_worked, left, workers, progress=name):
        _save(store, key, result)
    return {key: _load(store, f"{name}/{key}") for key in tasks}


def _worked(task: tuple[str, Callable[..., Any], tuple[Any, ...]]) -> Any:
    _, work, arguments = task
    return work(*arguments)


def _save(store: Store, key: str, result: Any) -> None:
    if not isinstance(result, Solution):
        store.save(key, {"value": jsonable(result)})
        return
    file = f"{key}.gait.npz"
    (store.folder / file).parent.mkdir(parents=True, exist_ok=True)
    result.save(store.folder / file)
    store.save(key, {"gait": file}, [file])


def _load(store: Store, key: str) -> Any:
    content = store.load(key)
    return content["value"] if "value" in content else Solution.load(store.folder / content["gait"])


def gaits_of(results: Mapping[str, Any]) -> dict[str, Solution]:
    """The results that are gaits; others are reasons why there is none."""
    return {key: each for key, each in results.items() if isinstance(each, Solution)}


def regenerating(problem: Problem) -> Problem:
    """The problem with E in place of E+, whose landscape is smoother."""
    phases = tuple(dataclasses.replace(phase, floor=-math.inf) for phase in problem.phases)
    return dataclasses.replace(problem, phases=phases)


def search_mesh(problem: Problem) -> Mesh:
    """The mesh of a search."""
    return Mesh.uniform(problem, *SEARCH_MESH, control_degree=CONTROL_DEGREE)


def with_turns(guess: Guess, turns: int) -> Guess:
    """A guess of one step that makes so many turns of theta, by turning steadily in addition."""
    (phase,) = guess
    states = phase.states.copy()
    missing = 2 * math.pi * turns - (states[-1, -1, 1] - states[0, 0, 1])
    share = np.linspace(0.0, 1.0, states[..., 0].size).reshape(states.shape[:2])
    states[..., 1] += missing * share
    states[..., 3] += missing / phase.duration
    return (dataclasses.replace(phase, states=states),)


def refined(problem: Problem, near: Outcome | Extremal, **options: Any) -> Extremal:
    """The optimum near one of the search, on a finer mesh; `options` are those of `solve`."""
    return solve(
        problem,
        near.phases,
        Mesh.uniform(problem, *FIRST_MESH, control_degree=CONTROL_DEGREE),
        parameters=near.parameters,
        tolerance=MESH_ERROR,
        hamiltonian_tolerance=HAMILTONIAN,
        verify=False,
        **options,
    )
