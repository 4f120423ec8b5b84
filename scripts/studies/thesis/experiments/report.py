"""`results.json`, and a page with tables, findings and figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from agents.page.write import write_page
from agents.reports.document import document, listed, paragraph, section, subsection
from agents.reports.plots import plots
from agents.reports.tables import Column, table
from rimless_gym.checks import MissingExtraError
from scripts.studies.thesis.experiments import figures
from scripts.studies.thesis.experiments.findings import FINDINGS
from scripts.studies.thesis.experiments.solved import Solved
from trajopt.files import write_text

TITLE = "The thesis's experiments, solved"

LEAD = (
    "B. T. Mihevc's six experiments (RIT, 2015) as optimal control problems, from many starts, "
    "simulated again by an independent simulator. Click a heading to sort; point at a plot, or "
    "touch it, to read its values."
)

COLUMNS = (
    Column("variant", "variant"),
    Column("experiment", "experiment", "d"),
    Column("cost, thesis", "thesis_cost", ".6f"),
    Column("cost", "cost", ".6f"),
    Column("energy, thesis (J)", "thesis_energy_J", ".6f"),
    Column("energy (J)", "energy_J", ".6f"),
    Column("t_f (s)", "final_time", ".4f"),
    Column("state error", "max_state_error", ".1e", "of the simulation, at most"),
    Column("touchdown error (s)", "touchdown_time_error", ".1e"),
    Column(
        "at 1 kHz", "thesis_style_state_error", ".1e", "state error, simulated as in the thesis"
    ),
    Column("least Fy / weight", "min_normal_force_over_weight", ".3f"),
    Column("peak V", "peak_voltage", ".2g"),
    Column("starts", "starts", "d"),
    Column("to the best", "starts_reaching_best", "d", "starts that came to the best optimum"),
    Column("converged", "verdict"),
)


def write(solutions: Sequence[Solved], folder: Path) -> None:
    """Write ``results.json``, ``report.html`` and the page that it leads to into a folder.

    Without the extra "learn" there is no such page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = [row for solution in solutions for row in solution.rows()]
    write_text(folder / "results.json", json.dumps(rows, indent=1, allow_nan=False) + "\n")
    try:
        link = write_page(folder / "page.html").name
    except MissingExtraError:
        link = None
    write_text(folder / "report.html", report(solutions, link))


def report(solutions: Sequence[Solved], link: str | None = None) -> str:
    """The report as one self-contained HTML file.

    Args:
        solutions: of the experiments.
        link: to the page of `rimless page`, if there is one.
    """
    rows, anchors = [], []
    for i, solution in enumerate(solutions):
        own = solution.rows()
        rows += [row | {"verdict": "yes" if row["converged"] else "NO"} for row in own]
        anchors += [f"case-{i}"] * len(own)
    parts = [section("All cases", table(COLUMNS, rows, anchors))]
    for number in sorted({solution.key[0] for solution in solutions}):
        cases = [
            _case(solution, f"case-{i}")
            for i, solution in enumerate(solutions)
            if solution.key[0] == number
        ]
        parts.append(section(f"Experiment {number}", listed(FINDINGS[number]), *cases))
    return document(TITLE, LEAD, parts, link)


def _case(solution: Solved, anchor: str) -> str:
    drawn = (figures.trajectories, figures.verification, figures.power)
    optima = ", ".join(f"{cost:.6g} ({count}x)" for cost, count, _ in solution.optima[:8])
    chosen = "".join(
        f"; {name} = {value:.6g}"
        for name, value in zip(
            solution.extremal.problem.parameters, solution.extremal.parameters, strict=True
        )
    )
    return subsection(
        " and ".join(printed.variant for printed in solution.case.printed),
        paragraph(
            f"Local optima, with how many of {solution.case.effort.starts} starts came to them: "
            f"{optima}; {solution.failed} failed{chosen}. {solution.seconds:.1f} s."
        ),
        plots([chart for draw in drawn for chart in draw(solution)]),
        anchor=anchor,
    )
