"""The trials' results as sections of docs/learning.md."""

from __future__ import annotations

import math
from pathlib import Path

from rimless_gym.commands.documents import marked
from rimless_gym.commands.documents.markdown import table
from rimless_gym.commands.learning_trials.trials import RANDOM, RANDOM_STARTS, Family, Steady

SECTIONS = ("steady", "random")
MARKS, WANTED = marked.marks("learning", SECTIONS), marked.wanted("learning", SECTIONS)


def refresh(page: Path, sections: dict[str, str]) -> None:
    """Put every section between its marks."""
    marked.refresh(page, MARKS, {name: f"{text}\n" for name, text in sections.items()})


def steady_table(found: list[Steady]) -> str:
    """What steady voltages do."""
    head = ["voltage / limit", "falls", "rolls on", "CoT", "speed (m/s)", "reward (m/s)"]
    rows = []
    for each in found:
        figures = ["-", "-"]
        if math.isfinite(each.cot):
            figures = [f"{each.cot:.2f}", f"{each.speed:.2f}"]
        shares = [f"{100 * share:.0f} %" for share in (each.falls, each.steps)]
        rows.append([f"{each.share:+.1f}", *shares, *figures, f"{each.reward:+.2f}"])
    return table(head, rows)


def random_table(found: list[Family]) -> str:
    """Which families random smooth policies find."""
    head = [
        "turns per step",
        f"policies of {RANDOM} that walk so",
        f"from all {RANDOM_STARTS} starts",
        "least CoT",
    ]
    rows = [[f"{f.turns:+d}", f.policies, f.everywhere, f"{f.cot:.2f}"] for f in found]
    return table(head, rows)
