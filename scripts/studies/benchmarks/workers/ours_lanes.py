"""Our environment with another number of lanes in its stepping kernel.

That number is a constant in the source, so this measures a copy of the package with another number.
The motions are the same: with 1, 8 and 16 lanes to the last bit.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import shutil
import sys
from pathlib import Path
from typing import Any

from ..protocol import Measure, serve

PACKAGE = Path(__file__).resolve().parents[3]

#: The file with the number, and its line there.
FILE, LINE = Path("kernel", "tile.py"), "\nLANES = 8\n"


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Do what another of our workers does, with so many `lanes`.

    Raises:
        RuntimeError: the copy cannot be made, or something else was imported.
    """
    sys.path.insert(0, str(copied(PACKAGE, settings["lanes"], Path(settings["folder"]))))
    worker = importlib.import_module(f"{__package__}.{settings['worker']}")
    lanes = importlib.import_module("rimless_gym.kernel.tile")
    if settings["lanes"] != lanes.LANES:
        raise RuntimeError(f"{lanes.__file__} was imported, with {lanes.LANES} lanes")
    measure, about = worker.setup(settings)
    return measure, about


def copied(package: Path, lanes: int, folder: Path) -> Path:
    """A folder with a copy of the package that has so many lanes, made if it is not there yet.

    Compiled code stays in the copy for the next run.

    Args:
        package: folder of the package.
        lanes: how many.
        folder: in which the copy's folder is.

    Raises:
        RuntimeError: the package has no line, or several, that sets the number of lanes to 8.
    """
    text = (package / FILE).read_text()
    if text.count(LINE) != 1:
        raise RuntimeError(
            f"{package / FILE}: has {text.count(LINE)} lines {LINE.strip()!r} to replace, not 1; "
            f"change LINE in {__file__}"
        )
    sources = b"".join(file.read_bytes() for file in sorted(package.rglob("*.py")))
    home = folder / f"lanes-{lanes}-{hashlib.sha256(sources).hexdigest()[:14]}"
    if not home.exists():
        part = home.with_suffix(f".{os.getpid()}")
        ignored = shutil.ignore_patterns("__pycache__", "commands")
        shutil.copytree(package, part / package.name, ignore=ignored)
        changed = text.replace(LINE, f"\nLANES = {lanes}\n")
        (part / package.name / FILE).write_text(changed)
        part.rename(home)
    return home


if __name__ == "__main__":
    serve(setup)
