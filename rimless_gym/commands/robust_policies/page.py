"""How robust policies are, as tables of docs/learning.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rimless_gym.commands.documents import marked
from rimless_gym.commands.feedback_laws.gait_tables import (
    machines_table,
    nuisances_table,
    pushes_table,
)

TABLES = {"nuisances": nuisances_table, "pushes": pushes_table, "machines": machines_table}
MARKS = marked.marks("robustness", tuple(TABLES))
WANTED = marked.wanted("robustness", tuple(TABLES))


def sections(found: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """The tables.

    Args:
        found: name of a policy -> column -> what was measured.
    """
    rows = {f"`{name}`": {"attraction": None, **columns} for name, columns in found.items()}
    return {name: table(rows) for name, table in TABLES.items()}


def refresh(page: Path, tables: Mapping[str, str]) -> None:
    """Put the tables between their marks."""
    marked.refresh(page, MARKS, {name: f"{text}\n" for name, text in tables.items()})
