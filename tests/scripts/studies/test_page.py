"""The study's tables in a page."""

from __future__ import annotations

from pathlib import Path

from scripts.studies import page
from scripts.studies.rows import FIRST_EVENING, LEARNED

PAGE = Path(__file__).resolve().parents[3] / "docs" / "learning.md"


def test_a_page_is_filled_the_same_way_twice(tmp_path: Path) -> None:
    text = tmp_path / "learning.md"
    text.write_text(PAGE.read_text())
    sections = {LEARNED: "| a |\n| --- |", FIRST_EVENING: "| b |\n| --- |"}
    page.refresh(text, sections)
    once = text.read_text()
    page.refresh(text, {LEARNED: sections[LEARNED]})
    assert text.read_text() == once
    assert "| a |" in once
    assert "| b |" in once
