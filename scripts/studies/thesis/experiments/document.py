"""The tables and figures of docs/thesis.md, written into it."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.reports.paper import printed, save
from scripts.studies.documents import markdown
from scripts.studies.thesis.experiments import figures
from scripts.studies.thesis.experiments.solved import Solved

#: The figures that the document shows, by file name: experiment and variant.
SHOWN = {
    "experiment_1": (1, "cost 4.4"),
    "experiment_2": (2, "|theta'| <= 8 pi at the end"),
    "experiment_3": (3, "cost 4.6, m2 = 1 kg"),
    "experiment_4": (4, "cost 4.6, m2 = 1 kg"),
    "experiment_5": (5, "plastic, phi'(0) <= 10"),
    "experiment_6": (6, "elastic, step 2"),
}

#: What is drawn of each, by the end of its file's name.
DRAWN = {
    "": figures.trajectories,
    "_verified": figures.verification,
    "_power": figures.power,
}

#: Width and height of each chart (inches).
SIZE = (7.6, 1.9)

COLUMNS = (
    *("", "variant", "cost, thesis", "cost", "energy, thesis (J)", "energy (J)", "t_f (s)"),
    *("state error", "touchdown error (s)", "least Fy / weight", "starts to the best"),
)

MARKS = re.compile(r"(<!-- (table|at 1 kHz) -->\n).*?(<!-- end of \2 -->)", re.DOTALL)

#: What a page must contain, at least one of the two, in words.
WANTED = (
    "<!-- table --> and <!-- end of table -->, or <!-- at 1 kHz --> and <!-- end of at 1 kHz -->"
)


def figures_of(page: Path) -> Path:
    """The folder beside a page that figures and results are put into."""
    return page.parent / "figures" / "thesis"


def refresh(page: Path, solutions: Sequence[Solved]) -> None:
    """Put the table into a page, and its figures and results into ``figures/thesis`` beside it."""
    folder = figures_of(page)
    folder.mkdir(parents=True, exist_ok=True)
    rows = [row for solution in solutions for row in solution.rows()]
    (folder / "results.json").write_text(json.dumps(rows, indent=1, allow_nan=False) + "\n")
    for name, key in SHOWN.items():
        for solution in solutions:
            if solution.key == key:
                for suffix, draw in DRAWN.items():
                    drawn = printed(draw(solution), across=1, size=SIZE, own_legends=True)
                    save(drawn, folder / f"{name}{suffix}.png", dpi=100)
    page.write_text(filled(page.read_text(), rows))


def filled(text: str, rows: Sequence[dict[str, Any]]) -> str:
    """A page with the tables of results between their marks."""
    tables = {"table": table(rows), "at 1 kHz": verification_table(rows)}
    return MARKS.sub(lambda marks: marks[1] + tables[marks[2]] + marks[3], text)


def verification_table(rows: Sequence[dict[str, Any]]) -> str:
    """What a verification as in the thesis says of its solutions and of ours."""
    lines = []
    for row in rows:
        if row["thesis_cost"] is None:
            continue
        late = row["thesis_touchdown_time_error"]
        own = ", ".join(
            "-" if error is None else f"{error:.0e}"
            for error in row["thesis_style_touchdown_time_errors"]
        )
        first = row["experiment"], row["variant"], "-" if late is None else f"{late:g}"
        lines.append((*first, own, f"{row['thesis_style_state_error']:.0e}"))
    head = "", "variant", "off in the thesis (s)", "touchdowns off (s)", "states off"
    return markdown.table(head, lines) + "\n"


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The main figures of every row."""
    return markdown.table(COLUMNS, map(_cells, rows)) + "\n"


def _cells(row: dict[str, Any]) -> list[str]:
    def number(key: str, form: str) -> str:
        return "-" if row[key] is None else format(row[key], form)

    variant = row["variant"]
    return [
        str(row["experiment"]),
        variant if row["converged"] else f"{variant} (not converged)",
        number("thesis_cost", ".6f"),
        number("cost", ".6f"),
        number("thesis_energy_J", ".6f"),
        number("energy_J", ".6f"),
        number("final_time", ".4f"),
        number("max_state_error", ".0e"),
        number("touchdown_time_error", ".0e"),
        number("min_normal_force_over_weight", ".2f"),
        f"{row['starts_reaching_best']} of {row['starts']}",
    ]
