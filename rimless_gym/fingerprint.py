"""Digests of sources, part of the file names of compiled code kept on disk.

A compiled function may contain functions from any file of this package and of its own, so a change
in any of them makes it stale.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path


def _digest(folders: Iterable[Path]) -> int:
    sources = [source for folder in folders for source in sorted(folder.rglob("*.py"))]
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()
    return int.from_bytes(digest[:7], "big")


@functools.cache
def package_fingerprint(package: str) -> int:
    """The digest of a top-level package's sources; of nothing where it has no folder."""
    return _digest(Path(folder) for folder in getattr(sys.modules[package], "__path__", []))


#: Of this package.
SOURCE_FINGERPRINT = _digest([Path(__file__).parent])
