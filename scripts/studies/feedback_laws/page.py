"""The study's results as sections of docs/feedback.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scripts.studies.documents import markdown
from scripts.studies.feedback_laws.gait_tables import gait_section
from scripts.studies.feedback_laws.summary import summary

SECTIONS = ("summary", "gaits")
MARKS, WANTED = markdown.marks("feedback", SECTIONS), markdown.wanted("feedback", SECTIONS)


def refresh(page: Path, found: Mapping[str, Any]) -> None:
    """Put every section between its marks."""
    markdown.refresh(page, MARKS, sections(found))


def sections(found: Mapping[str, Any]) -> dict[str, str]:
    """All sections by name."""
    gaits = [gait_section(key, found) for key in found["gaits"]]
    return {
        "summary": summary(found) + "\n",
        "gaits": "\n\n".join(["\n\n".join(parts) for parts in gaits]) + "\n",
    }
