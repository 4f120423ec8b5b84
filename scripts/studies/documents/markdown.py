"""What every page is written with: tables in Markdown, and counts in few digits."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from string import Formatter
from typing import Any

from trajopt.store import write_text


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table, without a line break at its end."""
    lines = [head, ["---"] * len(head), *rows]
    texts = [[str(cell).replace("|", r"\|") for cell in line] for line in lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in texts)


def formatted(columns: Mapping[str, str], rows: Iterable[Mapping[str, Any]]) -> str:
    """A table whose columns are headings and formats; a dash where a row has no figure (None)."""
    return table(list(columns), [[_cell(form, row) for form in columns.values()] for row in rows])


def _cell(form: str, row: Mapping[str, Any]) -> str:
    fields = [name for _, name, _, _ in Formatter().parse(form) if name]
    return "-" if any(row[name] is None for name in fields) else form.format(**row)


def percent(share: float) -> str:
    """A share without decimals."""
    return f"{100 * share:.0f} %"


def count(number: float) -> str:
    """A number, or a rate, with three digits and in thousands or millions."""
    for factor, unit in ((1e6, " M"), (1e3, " k")):
        if number >= factor:
            return f"{number / factor:.3g}{unit}"
    return f"{number:.3g}"


Marks = dict[str, re.Pattern[str]]


def marks(study: str, names: tuple[str, ...]) -> Marks:
    """What is found around the sections of a study, by their names."""
    return {
        name: re.compile(rf"(<!-- {study}: {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
        for name in names
    }


def wanted(study: str, names: tuple[str, ...]) -> str:
    """The marks as a user should write them."""
    return ", ".join(f"<!-- {study}: {name} --> and <!-- end of {name} -->" for name in names)


def refresh(page: Path, around: Marks, sections: Mapping[str, str]) -> None:
    """Put every section between its marks."""
    text = page.read_text()
    for name, section in sections.items():
        text = around[name].sub(lambda found, new=section: found[1] + new + found[2], text)  # type: ignore[misc]
    write_text(page, text)
