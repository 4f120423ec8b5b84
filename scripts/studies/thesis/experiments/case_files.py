"""Solved cases in files, so that an interrupted run can go on."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from scripts.studies.thesis.experiments.case import Case, Key
from scripts.studies.thesis.experiments.solve import of_durations, simulated
from scripts.studies.thesis.experiments.solved import Solved
from trajopt.ocp.extremal import Extremal, ExtremalFileError
from trajopt.provenance import provenance

#: Fields of `Solved` about the search, which a file keeps beside the best solution.
SEARCH = ("optima", "failed", "reaching", "seconds")


def place(folder: Path, key: Key) -> Path:
    """The file of a case."""
    experiment, variant = key
    return folder / f"{experiment}_{re.sub(r'[^0-9A-Za-z.]+', '_', variant)}.npz"


def store(folder: Path, solution: Solved) -> None:
    """Save a solved case."""
    folder.mkdir(parents=True, exist_ok=True)
    search = {name: getattr(solution, name) for name in SEARCH}
    made = solution.extremal.provenance | {"search": search}
    dataclasses.replace(solution.extremal, provenance=made).save(place(folder, solution.key))


def recalled(folder: Path, cases: Sequence[Case]) -> dict[Key, Solved]:
    """The cases that a folder holds, solved with the software as it is now; by key, in order."""
    found: dict[Key, Solved] = {}
    for case in cases:
        before = found.get(case.after.key) if case.after else None
        path = place(folder, case.key)
        if path.is_file() and (case.after is None or before):
            solution = _recalled(path, case, before)
            if solution is not None:
                found[case.key] = solution
    return found


def _recalled(path: Path, case: Case, before: Solved | None) -> Solved | None:
    problem = case.problem(before.extremal if before else None)
    try:
        extremal = Extremal.load(path, problem)
    except ExtremalFileError:
        return None
    search = extremal.provenance.pop("search", None)
    if search is None or extremal.provenance != provenance():
        return None
    if case.quickest:
        fixed = of_durations(problem, extremal.phases)
        extremal = dataclasses.replace(extremal, problem=fixed)
    search["optima"] = tuple(map(tuple, search["optima"]))
    return Solved(case.key, extremal, **search, **simulated(case, extremal, before))


def forget(folder: Path, cases: Sequence[Case]) -> None:
    """Remove the files of some cases, and the folder if nothing else is in it."""
    for case in cases:
        place(folder, case.key).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
