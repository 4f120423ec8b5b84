"""Named tuples whose fields come from other tables, and layouts of arrays made of them."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from typing import Any


def record(name: str, fields: Iterable[str], module: str) -> Any:
    """A named tuple class. `module` is where it is assigned to `name`; pickles need it."""
    return namedtuple(name, list(fields), module=module)


def places(kind: Any) -> Any:
    """The named tuple (0, 1, 2, ...): the index of each field of `kind` in an array."""
    return kind(*range(len(kind._fields)))
