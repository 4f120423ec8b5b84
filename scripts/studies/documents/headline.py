"""The README's headline: its last column is what docs/learning.md says over seeds."""

from __future__ import annotations

from pathlib import Path

from agents.comparison.headline import SHOWN
from agents.reports.tables import NONE
from scripts.studies.documents import markdown
from scripts.studies.documents.over_seeds import over_seeds

#: The command whose section it is, and its name there.
COMMAND, HEADLINE = "compare", "headline"
MARKS, WANTED = markdown.marks(COMMAND, (HEADLINE,)), markdown.wanted(COMMAND, (HEADLINE,))


def refresh_gaps(page: Path, learning: Path) -> None:
    """Fill the last column anew; nothing else changes.

    Args:
        page: with the headline.
        learning: docs/learning.md.

    Raises:
        ValueError: a row that the headline may have is in no table of `learning`.
    """
    found = MARKS[HEADLINE].search(page.read_text())
    if found is None:
        raise ValueError(f"{page}: has no {WANTED}")
    gaps = over_seeds(learning.read_text())
    told = {meaning: gaps.get(title, NONE) for title, meaning in SHOWN.items()}
    lines = [_told(line, told) for line in found[0].splitlines()[1:-1]]
    markdown.refresh(page, MARKS, {HEADLINE: "\n".join(lines) + "\n"})


def _told(line: str, told: dict[str, str]) -> str:
    """A line of the headline with another last cell; its head as it is."""
    cells = line.strip("| ").split(" | ")
    if cells[0] not in told:
        return line
    return "| " + " | ".join([*cells[:-1], told[cells[0]]]) + " |"
