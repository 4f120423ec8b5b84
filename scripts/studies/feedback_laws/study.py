"""The whole study: gaits, then decision times, then everything else."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from scripts.studies.feedback_laws.cells import Cell, cells, measured
from scripts.studies.feedback_laws.columns import COLUMNS, TIMING
from scripts.studies.feedback_laws.gaits import Held, kept
from scripts.studies.feedback_laws.keeping import Measure, completed
from scripts.studies.feedback_laws.sizes import SLOW
from trajopt.files import jsonable, write_text
from trajopt.gaits.solution import Solution
from trajopt.provenance import provenance


def study(
    folder: Path,
    gaits: Sequence[Held],
    names: Sequence[str],
    workers: int,
    quick: bool,
    measure: Measure = measured,
) -> dict[str, Any]:
    """Everything, as plain JSON values, which are also written to results.json.

    Args:
        folder: of the study; what is finished is read from it.
        gaits: about which the laws are measured.
        names: of the laws.
        workers: processes.
        quick: whether this is a trial.
        measure: what measures a cell.
    """
    paths = kept(folder / "gaits", gaits)
    keys, place = list(paths), folder / "cells"
    timed = [Cell(gait, law, TIMING, False, quick) for gait in keys for law in names]
    # One at a time, or they would slow each other down.
    times = completed(place, "decision times", timed, paths, measure, 1)
    slow = _slow(times, names)
    rest = completed(place, "laws", cells(keys, list(names), slow, quick), paths, measure, workers)
    results: dict[str, Any] = {gait: {law: {} for law in names} for gait in keys}
    errors = {}
    for cell, each in (times | rest).items():
        results[cell.gait][cell.law][cell.column] = each.get("found")
        if "error" in each:
            errors[cell.key] = each["error"]
    seconds = sum(each.get("seconds", 0.0) for each in (times | rest).values())
    found = {
        "quick": quick,
        "slow_laws": sorted(slow),
        "columns": list(COLUMNS),
        "gaits": {key: _figures(held, paths[key]) for key, held in zip(keys, gaits, strict=True)},
        "results": results,
        "errors": errors,
        "minutes_of_one_core": seconds / 60,
        "provenance": provenance(),
    }
    write_text(folder / "results.json", json.dumps(jsonable(found)) + "\n")
    return dict(jsonable(found))


def _slow(times: dict[Cell, dict[str, Any]], names: Sequence[str]) -> set[str]:
    """The laws whose decision in a batch takes longer than `SLOW`, by the median of the gaits."""
    slow = set()
    for law in names:
        known = [
            each["found"]["batch"] for c, each in times.items() if c.law == law and "found" in each
        ]
        if known and median(known) > SLOW:
            slow.add(law)
    return slow


def _figures(held: Held, path: Path) -> dict[str, Any]:
    gait = Solution.load(path)
    return {
        "preset": held.preset,
        "asked_speed": held.speed,
        "speed": gait.speed,
        "cot": gait.cot,
        "steps": gait.steps,
        "turns": gait.theta_turns,
        "momentum": gait.params.total_mass * gait.speed,
        "friction": gait.params.friction,
        "friction_demand": gait.verification.max_friction_demand,
        "least_force": gait.verification.min_normal_force_over_weight,
    }
