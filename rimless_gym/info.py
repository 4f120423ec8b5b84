"""What `info` holds: dense arrays over the rows, or the entries of one step.

The single environment's is a dictionary whose entries are made when they are looked at: making two
dozen numbers takes longer than their physics, and most of them are never read. (In C, an empty
dictionary is told by its size without asking its methods, so `failure` is there from the start.)
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.hybrid import FAILURES, MODE_NAMES
from rimless_gym.interval import (
    BLOCK_SIZE,
    FAILURE_MARK,
    INFO_NAMES,
    MARKS,
    MODE_MARK,
    N_MARKS,
    SLIPS,
    TERMINATED,
    marks,
)

_BLOCK = struct.Struct(f"{BLOCK_SIZE - 1}d{N_MARKS}b")


class StepInfo(dict[str, Any]):
    """The entries of one step, made when somebody looks for one of them.

    Everything else about it is a dictionary's; copies are plain dictionaries.

    Attributes:
        block: the bytes of a block of one row (`rimless_gym.interval`), None once they are read.
    """

    __slots__ = ("block",)

    block: bytes | None

    def __getattr__(self, name: str) -> None:
        if name != "block":
            raise AttributeError(name)  # else one that nobody gave a block: an ordinary dictionary

    def fill(self) -> None:
        """Make the entries, but for those that were written before."""
        block, self.block = self.block, None
        if block is not None:
            for name, value in entries(block).items():
                dict.setdefault(self, name, value)

    def get(self, name: str, default: Any = None) -> Any:
        """The entry, or the default where there is none."""
        if name in NAMES:
            self.fill()
        return dict.get(self, name, default)

    def __contains__(self, name: object) -> bool:
        return (self.block is not None and name in NAMES) or dict.__contains__(self, name)

    def __missing__(self, name: str) -> Any:
        if self.block is None:
            raise KeyError(name)
        self.fill()
        return self[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def _filled(name: str) -> Callable[..., Any]:
    method = getattr(dict, name)

    def call(self: StepInfo, *arguments: Any) -> Any:
        self.fill()
        return method(self, *arguments)

    return call


for _name in (
    *("__delitem__", "__eq__", "__iter__", "__len__", "__ne__", "__or__", "__repr__"),
    *("__reversed__", "__ror__", "clear", "copy", "items", "keys", "pop", "popitem"),
    *("setdefault", "values"),
):
    setattr(StepInfo, _name, _filled(_name))


def entries(block: bytes) -> dict[str, Any]:
    """The entries in a block of one row."""
    values = _BLOCK.unpack(block)
    codes = values[MARKS:]
    info = dict(zip(INFO_NAMES, values, strict=False))
    info["slips"] = bool(codes[SLIPS])
    info["mode"] = MODE_NAMES[codes[MODE_MARK]]
    info["failure"] = FAILURES[codes[FAILURE_MARK]] if codes[TERMINATED] else None
    return info


#: What every step's `info` has.
NAMES = frozenset({*INFO_NAMES, "slips", "mode", "failure"})


def dense_info(block: NDArray[np.float64]) -> dict[str, Any]:
    """The entries of all rows, views (N,) of the block; modes and failures as codes."""
    codes = marks(block)
    info: dict[str, Any] = dict(zip(INFO_NAMES, block, strict=False))
    info["slips"] = codes[SLIPS].view(np.bool_)
    info["mode"], info["failure"] = codes[MODE_MARK], codes[FAILURE_MARK]
    return info


def final_info(
    ended: NDArray[np.bool_], observations: NDArray[np.float32], block: NDArray[np.float64]
) -> dict[str, Any]:
    """What the episodes that ended, if any, ended with, in Gymnasium's form."""
    rows = ended.nonzero()[0]
    if not len(rows):
        return {}
    seen, last = np.zeros_like(observations), np.zeros(block.shape)
    seen[rows], last[:MARKS, rows] = observations[rows], block[:MARKS, rows]
    marks(last)[:, rows] = marks(block)[:, rows]
    return {
        "final_obs": seen,
        "_final_obs": ended.copy(),
        "final_info": dense_info(last),
        "_final_info": ended.copy(),
    }
