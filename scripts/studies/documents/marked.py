"""Sections of a page that a command writes, each between two marks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from trajopt.files import write_text

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
