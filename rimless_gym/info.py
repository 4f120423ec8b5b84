"""The single environment's `info`: a dictionary whose entries are made when they are looked at.

Making two dozen numbers takes longer than their physics, and most of them are never read. (In C,
an empty dictionary is told by its size without asking its methods, so `failure` is always there.)
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

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
    marks = values[MARKS:]
    info = dict(zip(INFO_NAMES, values, strict=False))
    info["slips"] = bool(marks[SLIPS])
    info["mode"] = MODE_NAMES[marks[MODE_MARK]]
    info["failure"] = FAILURES[marks[FAILURE_MARK]] if marks[TERMINATED] else None
    return info


#: What every step's `info` has.
NAMES = frozenset({*INFO_NAMES, "slips", "mode", "failure"})
