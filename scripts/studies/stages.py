"""Stages of a study: tasks side by side, whose results, gaits among them, are stored."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from trajopt import pool
from trajopt.gaits.solution import Solution
from trajopt.store import Store, jsonable


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
