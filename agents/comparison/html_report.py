"""The comparison as one HTML file: its table, and its plots with their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.comparison.arena import Arena
from agents.comparison.charts import learning_charts, speed_charts
from agents.comparison.learning_curves import Curve
from agents.comparison.report import COLUMNS, NOTES, distinct
from agents.page.write import write_page
from agents.reports.charts import Chart
from agents.reports.document import document, paragraph, section
from agents.reports.plots import plots
from agents.reports.tables import table
from rimless_gym.presets import machine_name
from trajopt.files import write_text
from trajopt.gaits.fronts import NoFrontError

LEAD = (
    "Optimal gaits, feedback laws that hold them, and policies learned on the same model, all "
    "measured in the same way. The machine: {machine}. Click a heading to sort; point at a plot, "
    "or touch it, to read its values."
)

ABOUT_DEVIATIONS = (
    "The last 10 s of a walk from rest, step by step, less the environment's own optimum at the "
    "same share of the step's time. A walk that repeats the optimum lies on zero."
)

ABOUT_RETURNS = (
    "Small pushes, and the touchdowns after them. The steady walk is where a touchdown is like the "
    "one before; how fast pushed walks come back is told by the multipliers, by which small "
    "deviations grow in a step. One near 1 is that of a walk which drifts through the ticks of the "
    "control and never quite repeats itself. A multiplier whose direction turns has no slope."
)


def write_report(
    arena: Arena,
    rows: list[dict[str, Any]],
    walks: tuple[Sequence[Chart], Sequence[Chart]],
    curves: Mapping[str, Curve],
) -> None:
    """Write report.html into the study's folder, and page.html where its machine has one.

    Args:
        arena: of the comparison that is over.
        rows: of its table.
        walks: the charts of deviations and those of return maps.
        curves: milestones of trainings, by their names.
    """
    deviations, returns = walks
    parts = [
        section("Learned against optimal", table(COLUMNS, distinct(rows)), paragraph(NOTES)),
        section("On the front", plots(speed_charts(arena.front, arena.held_front, rows))),
        section("Beside the optimal cycle", paragraph(ABOUT_DEVIATIONS), plots(deviations)),
        section("From step to step", paragraph(ABOUT_RETURNS), plots(returns)),
        section("How they learned", plots(learning_charts(curves, arena.held_front))),
    ]
    lead = LEAD.format(machine=machine_name(arena.params))
    text = document("Learned against optimal walking", lead, parts, _page(arena.out))
    write_text(arena.out / "report.html", text)


def _page(folder: Path) -> str | None:
    """The page with the study's own clone, beside the report."""
    clone = folder / "imitation" / "clone.zip"
    try:
        return write_page(folder / "page.html", clone).name
    except NoFrontError:
        return None
