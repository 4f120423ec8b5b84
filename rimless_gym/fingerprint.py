"""A digest of the package's sources, by which what is made of them is kept on disk.

A compiled function contains others, of any file: when any source changes, no stale machine code is
loaded.
"""

from __future__ import annotations

import hashlib
from pathlib import Path


def _digest() -> int:
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()
    return int.from_bytes(digest[:7], "big")


SOURCE_FINGERPRINT = _digest()
