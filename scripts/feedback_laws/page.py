"""The study's results as sections of docs/feedback.md."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from scripts.feedback_laws.gait_tables import gait_section
from scripts.feedback_laws.summary import summary
from trajopt.files import write_text

SECTIONS = ("summary", "gaits")
MARKS = {
    name: re.compile(rf"(<!-- feedback: {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    for name in SECTIONS
}

#: What a page must contain, in words.
WANTED = ", ".join(f"<!-- feedback: {n} --> and <!-- end of {n} -->" for n in SECTIONS)


def refresh(page: Path, found: Mapping[str, Any]) -> None:
    """Put every section between its marks."""
    text = page.read_text()
    for name, section in sections(found).items():
        text = MARKS[name].sub(partial(_between, section), text)
    write_text(page, text)


def _between(section: str, marks: re.Match[str]) -> str:
    return marks[1] + section + marks[2]


def sections(found: Mapping[str, Any]) -> dict[str, str]:
    """All sections by name."""
    gaits = [gait_section(key, found) for key in found["gaits"]]
    return {
        "summary": summary(found) + "\n",
        "gaits": "\n\n".join(["\n\n".join(parts) for parts in gaits]) + "\n",
    }
