"""A step's `info`, whose entries are made when somebody looks at them.

Making two dozen numbers takes longer than their physics, and most of them are never read. In C, an
empty dictionary is told by its size without asking its methods: store one entry from the start.

One kind of reader is not served so: jax's trees look into dictionaries of exactly that type alone.
Where there is jax, or Minari, which brings it, the environment gives plain copies (`serves_all`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from rimless_gym.envs.interval import INFO_NAMES

#: What every step's `info` has.
NAMES = frozenset({*INFO_NAMES, "slips", "mode", "failure"})


def serves_all() -> bool:
    """Whether all that may read `info` here takes a `LazyInfo` for the dictionary that it is."""
    return "jax" not in sys.modules and "minari" not in sys.modules


class LazyInfo(dict[str, Any]):
    """A dictionary with the entries that `source` makes, once one of them is looked for.

    What is written to it stays; everything else about it is a dictionary's, and copies are plain
    dictionaries.

    Attributes:
        source: a function that makes the entries `NAMES` and its arguments, None once it has.
    """

    __slots__ = ("source",)

    source: tuple[Any, ...] | None

    def __getattr__(self, name: str) -> None:
        if name != "source":
            raise AttributeError(name)  # else one that nobody gave a source: an ordinary dictionary

    def fill(self) -> None:
        """Make the entries, but for those that were written before."""
        source, self.source = self.source, None
        if source is not None:
            for name, value in source[0](*source[1:]).items():
                dict.setdefault(self, name, value)

    def get(self, name: str, default: Any = None) -> Any:
        """The entry, or the default where there is none."""
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
