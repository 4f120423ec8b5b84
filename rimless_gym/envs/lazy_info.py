"""A step's `info`, whose entries are made when they are first read.

Making two dozen Python numbers takes longer than computing them, and most are never read. C code
recognises an empty dictionary by its size, without calling its methods, so one entry is stored from
the start.

jax's trees look only into dictionaries of exactly the type `dict`. Where jax is imported, or
Minari, which uses it, the environment therefore returns plain copies (`serves_all`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from rimless_gym.envs.layout import INFO_NAMES

#: What every step's `info` has.
NAMES = frozenset({*INFO_NAMES, "slips", "mode", "failure"})


def serves_all() -> bool:
    """Whether every imported package that may read `info` treats a `LazyInfo` as a dictionary."""
    return "jax" not in sys.modules and "minari" not in sys.modules


class LazyInfo(dict[str, Any]):
    """A dictionary whose entries `source` makes when one of them is first read.

    What is written to it stays. It behaves like a dictionary otherwise; copies are plain ones.

    Attributes:
        source: a function that makes the entries `NAMES`, and its arguments; None once called.
    """

    __slots__ = ("source",)

    source: tuple[Any, ...] | None

    def __getattr__(self, name: str) -> None:
        if name != "source":
            raise AttributeError(name)  # without a source it is an ordinary dictionary

    def fill(self) -> None:
        """Make the entries, except those that were written before."""
        source, self.source = self.source, None
        if source is not None:
            for name, value in source[0](*source[1:]).items():
                dict.setdefault(self, name, value)

    def get(self, name: str, default: Any = None) -> Any:
        """The entry, or the default if there is none."""
        if name in NAMES:
            self.fill()
        return dict.get(self, name, default)

    def __contains__(self, name: object) -> bool:
        return (self.source is not None and name in NAMES) or dict.__contains__(self, name)

    def __missing__(self, name: str) -> Any:
        if self.source is None:
            raise KeyError(name)
        self.fill()
        return self[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def _filled(name: str) -> Callable[..., Any]:
    method = getattr(dict, name)

    def call(self: LazyInfo, *arguments: Any) -> Any:
        self.fill()
        return method(self, *arguments)

    return call


for _name in (
    *("__delitem__", "__eq__", "__iter__", "__len__", "__ne__", "__or__", "__repr__"),
    *("__reversed__", "__ror__", "clear", "copy", "items", "keys", "pop", "popitem"),
    *("setdefault", "values"),
):
    setattr(LazyInfo, _name, _filled(_name))
