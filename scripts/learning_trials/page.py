"""The trials' results as sections of docs/learning.md."""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path

from scripts.documents.tables import table
from scripts.learning_trials.trials import RANDOM, RANDOM_STARTS, Family, Steady
from trajopt.files import write_text

SECTIONS = ("steady", "random")
MARKS = {
    name: re.compile(rf"(<!-- learning: {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    for name in SECTIONS
}

#: What a page must contain, in words.
WANTED = ", ".join(f"<!-- learning: {n} --> and <!-- end of {n} -->" for n in SECTIONS)


def refresh(page: Path, sections: dict[str, str]) -> None:
    """Put every section between its marks."""
    text = page.read_text()
    for name, section in sections.items():
        text = MARKS[name].sub(partial(_between, section), text)
    write_text(page, text)


def _between(section: str, marks: re.Match[str]) -> str:
    return f"{marks[1]}{section}\n{marks[2]}"


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
