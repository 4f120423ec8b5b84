"""The shipped gaits of a preset, replaced by those of a search."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trajopt.files import write_text
from trajopt.gaits.solution import Solution


def record_file(name: str) -> str:
    """The name of the file with a search's record, beside the gaits."""
    return f"{name.lower()}_front.json"


def gait_file(name: str, gait: Solution) -> str:
    """The name of a shipped gait's file."""
    return f"{name.lower()}_{gait.steps}_steps_k{gait.theta_turns}_{gait.speed:.4f}.npz"


def ship(folder: Path, name: str, gaits: Sequence[Solution], found: dict[str, Any]) -> int:
    """Write a machine's gaits and the search's record; older gaits of the machine are deleted.

    Args:
        folder: of the library.
        name: of the machine.
        gaits: to be shipped.
        found: the record.

    Returns:
        The files' size (bytes).
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / gait_file(name, gait) for gait in gaits]
    for path, gait in zip(files, gaits, strict=True):
        gait.save(path)
    for path in folder.glob(f"{name.lower()}_*_steps_*.npz"):
        if path not in files:
            path.unlink()
    files.append(folder / record_file(name))
    write_text(files[-1], json.dumps(found, indent=1, allow_nan=False) + "\n")
    return sum(path.stat().st_size for path in files)
