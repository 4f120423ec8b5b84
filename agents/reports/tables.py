"""Tables whose rows can be sorted by a click on a heading."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

#: In place of a value that is missing.
NONE = "-"


class Column(NamedTuple):
    """A column.

    Attributes:
        heading: above it.
        key: of its value in a row. It sorts the rows.
        form: the format of a number, as in ".4f"; "" for a text.
        meaning: a sentence that explains it.
    """

    heading: str
    key: str
    form: str = ""
    meaning: str = ""

    def text(self, row: Mapping[str, Any]) -> str:
        """What the row has in this column, in words."""
        return figure(row[self.key], self.form)


def table(
    columns: Sequence[Column], rows: Sequence[Mapping[str, Any]], links: Sequence[str] = ()
) -> str:
    """A table as HTML; a value that is None, NaN or infinite is a dash, and is sorted to the end.

    Args:
        columns: the first one names a row.
        rows: one mapping per row.
        links: identities of the elements in the page to which the rows' names lead, if any.
    """
    head = "".join(map(_heading, columns))
    targets = links or [""] * len(rows)
    body = "\n".join(_row(columns, row, target) for row, target in zip(rows, targets, strict=True))
    return (
        '<div class="scrolling" tabindex="0"><table class="sortable">'
        f"<thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>"
    )


def _heading(column: Column) -> str:
    title = f' title="{escape(column.meaning)}"' if column.meaning else ""
    text = escape(column.heading)
    return f'<th scope="col"{title}><button type="button">{text}</button></th>'


def _row(columns: Sequence[Column], row: Mapping[str, Any], target: str) -> str:
    first, *others = columns
    name = escape(first.text(row))
    if target:
        name = f'<a href="#{escape(target)}">{name}</a>'
    cells = "".join(
        f'<td data-value="{_sorted_by(row[each.key])}">{escape(each.text(row))}</td>'
        for each in others
    )
    value = _sorted_by(row[first.key])
    return f'<tr><th scope="row" data-value="{value}">{name}</th>{cells}</tr>'


def figure(value: Any, form: str) -> str:
    """A value in words; what is missing, or not finite, is a dash."""
    return NONE if _missing(value) else format(value, form)


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def _sorted_by(value: Any) -> str:
    """What the value is sorted by; nothing where it is missing."""
    if _missing(value):
        return ""
    return escape(str(float(value) if isinstance(value, bool | int | float) else value))
