"""Named tuples whose fields come from other tables, and layouts of arrays made of them."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from typing import Any


def record(name: str, fields: Iterable[str], module: str) -> Any:
    """A class of named tuples; `module` is where it is assigned to `name`, for pickles."""
    return namedtuple(name, list(fields), module=module)


def places(kind: Any) -> Any:
    """The named tuple of 0, 1, 2, ...: where the fields of `kind` are in an array."""
    return kind(*range(len(kind._fields)))
