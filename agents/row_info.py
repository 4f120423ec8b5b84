"""One row's `info` out of arrays over all rows, made when somebody reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import NDArray

from rimless_gym.hybrid import FAILURES, MODE_NAMES
from rimless_gym.info import NAMES

Columns = Mapping[str, NDArray[Any]]


def row_of(columns: Columns, row: int) -> dict[str, Any]:
    """One row of the arrays (N,) in the native environment's `info`, as the single one has it."""
    info = {name: column.item(row) for name, column in columns.items()}
    info["mode"] = MODE_NAMES[info["mode"]]
    if "failure" in info:
        info["failure"] = FAILURES.get(info["failure"])
    return info


class RowInfo(dict[str, Any]):
    """A row of `columns`, whose entries are made as soon as somebody asks for one of them.

    A learner looks at few entries of few rows, and making all of them takes longer than the step.
    What is written to it stays; copies are plain dictionaries.
    """

    __slots__ = ("columns", "row")

    columns: Columns | None
    row: int

    def fill(self) -> None:
        """Make the entries, but for those that were written before."""
        columns, self.columns = self.columns, None
        if columns is not None:
            for name, value in row_of(columns, self.row).items():
                dict.setdefault(self, name, value)

    def get(self, name: str, default: Any = None) -> Any:
        """The entry, or the default where there is none."""
        if name in NAMES:
            self.fill()
        return dict.get(self, name, default)

    def __missing__(self, name: str) -> Any:
        if self.columns is None:
            raise KeyError(name)
        self.fill()
        return self[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def _filled(name: str) -> Callable[..., Any]:
    method = getattr(dict, name)

    def call(self: RowInfo, *arguments: Any) -> Any:
        self.fill()
        return method(self, *arguments)

    return call


for _name in (
    *("__contains__", "__delitem__", "__eq__", "__iter__", "__len__", "__ne__", "__or__"),
    *("__repr__", "__reversed__", "__ror__", "clear", "copy", "items", "keys", "pop", "popitem"),
    *("setdefault", "values"),
):
    setattr(RowInfo, _name, _filled(_name))
