"""What made a result: versions and git revision.

A process asks for them once: what it computes with was loaded when it began, and git takes a tenth
of a second to answer.
"""

from __future__ import annotations

import functools
import importlib.metadata
import subprocess
from pathlib import Path
from typing import Any


def provenance(**settings: Any) -> dict[str, Any]:
    """Versions of what computes, the git revision where there is one, and `settings`."""
    return {"versions": dict(_versions()), "git_revision": _git_revision(), **settings}


@functools.cache
def _versions() -> dict[str, str]:
    versions = {}
    for name in ("rimless-gym", "casadi", "numba", "numpy", "scipy"):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


@functools.cache
def _git_revision() -> str | None:
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        run = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=5
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip() or None
