"""A digest of the package's sources, for numba's caches: they look at one file each.

A compiled function that is kept on disk mentions `SOURCE_FINGERPRINT`, which makes it part of the
cache's key: when any source changes, no stale machine code is loaded.
"""

from __future__ import annotations

import hashlib
from pathlib import Path


def _digest() -> int:
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()
    return int.from_bytes(digest[:7], "big")


SOURCE_FINGERPRINT = _digest()
