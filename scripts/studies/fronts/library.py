"""The shipped gaits of a preset, replaced by those of a search."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from trajopt.files import write_text
from trajopt.gaits.library import ARCHIVE, gait_files, write_archive
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
        The archive's size (bytes).
    """
    folder.mkdir(parents=True, exist_ok=True)
    archive = folder / ARCHIVE.name
    files = {n: b for n, b in gait_files(archive).items() if not n.startswith(f"{name.lower()}_")}
    with TemporaryDirectory() as temporary:
        for gait in gaits:
            path = Path(temporary) / gait_file(name, gait)
            gait.save(path)
            files[path.name] = path.read_bytes()
    write_archive(archive, files)
    write_text(folder / record_file(name), json.dumps(found, indent=1, allow_nan=False) + "\n")
    return archive.stat().st_size
