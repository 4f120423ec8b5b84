"""A digest of the package's sources, part of the file names of compiled code kept on disk.

A compiled function may contain functions from any file, so a change in any source makes all
compiled code stale.
"""

from __future__ import annotations

import hashlib
from pathlib import Path


def _digest() -> int:
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()
    return int.from_bytes(digest[:7], "big")


SOURCE_FINGERPRINT = _digest()
