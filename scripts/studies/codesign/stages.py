"""The study's stages: results by name, computed side by side and kept in files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from trajopt.files import jsonable, write_text
from trajopt.gaits.solution import GaitFileError, Solution
from trajopt.processes import pool

#: What a stage finds: a gait, plain JSON values, or words on why there is nothing.
Found = Solution | dict[str, Any] | str


def stage(
    folder: Path,
    name: str,
    tasks: Mapping[str, tuple[Any, ...]],
    work: Callable[..., Any],
    workers: int,
) -> dict[str, Any]:
    """The results of `work` for every task, in the tasks' order.

    Each result is kept in a file when it is found, and read from it if it is there.

    Args:
        folder: of the study; this stage has a folder of its own in it.
        name: of the stage.
        tasks: arguments of `work` by the result's name.
        work: a function at the top of a module.
        workers: processes.
    """
    place = folder / name
    place.mkdir(parents=True, exist_ok=True)
    found = {key: each for key in tasks if (each := _kept(place, key)) is not None}
    with (
        tqdm(total=len(tasks), initial=len(found), desc=name) as bar,
        pool(workers) as submit,
    ):
        futures = {
            submit(work, *arguments): key for key, arguments in tasks.items() if key not in found
        }
        for future in as_completed(futures):
            key = futures[future]
            found[key] = future.result()
            _keep(place, key, found[key])
            bar.update()
    return {key: found[key] for key in tasks}


def _kept(place: Path, key: str) -> Found | None:
    gait, rest = place / f"{key}.npz", place / f"{key}.json"
    try:
        if gait.exists():
            return Solution.load(gait)
        if rest.exists():
            values: Found = json.loads(rest.read_text())
            return values
    except (GaitFileError, ValueError):
        return None  # damaged: it is computed again
    return None


def _keep(place: Path, key: str, found: Found) -> None:
    if isinstance(found, Solution):
        found.save(place / f"{key}.npz")
    else:
        write_text(place / f"{key}.json", json.dumps(jsonable(found), indent=1) + "\n")
