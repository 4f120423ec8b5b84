"""What `info` holds: dense arrays over the rows, or the entries of one row.

The entries are numbers and truth values. Each has the same type in every step and reset, so that
programs that collect episodes can make arrays of them.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.envs.layout import BLOCK, INFO_NAMES, MARK, marks

_BLOCK = struct.Struct(f"{BLOCK.marks}d8b")


def entries(block: bytes) -> dict[str, Any]:
    """The entries in a block of one row."""
    values = _BLOCK.unpack(block)
    codes = values[BLOCK.marks :]
    info = dict(zip(INFO_NAMES, values, strict=False))
    info["slips"] = bool(codes[MARK.slips])
    info["mode"], info["failure"] = codes[MARK.mode], codes[MARK.failure]
    return info


_NOTHING_YET = entries(bytes(8 * len(BLOCK)))


def begun(mode: int) -> dict[str, Any]:
    """The entries at the start of an episode: its mode, and 0 for everything else."""
    return _NOTHING_YET | {"mode": mode}


def dense_info(block: NDArray[np.float64], codes: NDArray[np.int8]) -> dict[str, Any]:
    """The entries of all rows, as views (N,) of a block and its marks."""
    info: dict[str, Any] = dict(zip(INFO_NAMES, block, strict=False))
    info["slips"] = codes[MARK.slips].view(np.bool_)
    info["mode"], info["failure"] = codes[MARK.mode], codes[MARK.failure]
    return info


def row_of(columns: Mapping[str, NDArray[Any]], row: int) -> dict[str, Any]:
    """One row of the dense arrays (N,), as the `info` of the single environment."""
    return {name: column.item(row) for name, column in columns.items()}


def final_info(
    ended: NDArray[np.bool_],
    observations: NDArray[np.float32],
    block: NDArray[np.float64],
    codes: NDArray[np.int8],
) -> dict[str, Any]:
    """The last observations and info of the episodes that ended, in Gymnasium's form."""
    rows = ended.nonzero()[0]
    if not len(rows):
        return {}
    seen, last = np.zeros_like(observations), np.zeros(block.shape)
    seen[rows], last[: BLOCK.marks, rows] = observations[rows], block[: BLOCK.marks, rows]
    marks(last)[:, rows] = codes[:, rows]
    return {
        "final_obs": seen,
        "_final_obs": ended.copy(),
        "final_info": dense_info(last, marks(last)),
        "_final_info": ended.copy(),
    }
