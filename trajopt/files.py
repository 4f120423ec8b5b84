"""What `trajopt.store` has replaced; deleted when nothing imports it any more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt import store
from trajopt.store import ABANDONED as ABANDONED
from trajopt.store import DIGEST as DIGEST
from trajopt.store import HEADER as HEADER
from trajopt.store import array_of as array_of
from trajopt.store import digest as digest
from trajopt.store import jsonable as jsonable
from trajopt.store import part_of as part_of
from trajopt.store import read_arrays as read_arrays
from trajopt.store import read_signed as read_signed
from trajopt.store import write_arrays as write_arrays
from trajopt.store import write_bytes as write_bytes
from trajopt.store import write_text as write_text


def write_signed(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON values with a digest; arrays become lists."""
    store.write_signed(path, jsonable(content))


def require_names(arrays: Mapping[str, NDArray[np.generic]], expected: Iterable[str]) -> None:
    """Refuse arrays that are not `expected`."""
    unknown = sorted(set(arrays) - set(expected))
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: no such arrays are known")
