"""`results.json`, and a page with tables, findings and figures."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from scripts.thesis.experiments import figures
from scripts.thesis.experiments.findings import FINDINGS
from scripts.thesis.experiments.solved import Solved
from trajopt.provenance import provenance

STYLE = """
body { font: 15px/1.45 sans-serif; max-width: 72em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; font-size: 13px; }
td, th { border-bottom: 1px solid #ccc; padding: 2px 8px; text-align: right; }
td:nth-child(2) { text-align: left; }
.no { color: #b00; font-weight: bold; }
.figures { display: flex; flex-wrap: wrap; gap: 1em; }
"""

#: Columns of the table: heading, key of a row, format.
COLUMNS = (
    ("exp.", "experiment", "d"),
    ("variant", "variant", "s"),
    ("cost, thesis", "thesis_cost", ".6f"),
    ("cost", "cost", ".6f"),
    ("energy, thesis (J)", "thesis_energy_J", ".6f"),
    ("energy (J)", "energy_J", ".6f"),
    ("t_f (s)", "final_time", ".4f"),
    ("state error", "max_state_error", ".1e"),
    ("touchdown error (s)", "touchdown_time_error", ".1e"),
    ("at 1 kHz", "thesis_style_state_error", ".1e"),
    ("least Fy / weight", "min_normal_force_over_weight", ".3f"),
    ("peak V", "peak_voltage", ".2g"),
    ("starts", "starts", "d"),
    ("to the best", "starts_reaching_best", "d"),
)


def write(solutions: Sequence[Solved], folder: Path) -> None:
    """Write ``results.json`` and ``report.html`` into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [row for solution in solutions for row in solution.rows()]
    (folder / "results.json").write_text(json.dumps(rows, indent=1, allow_nan=False) + "\n")
    (folder / "report.html").write_text(page(solutions))


def page(solutions: Sequence[Solved]) -> str:
    """The report as one self-contained page."""
    rows = [row for solution in solutions for row in solution.rows()]
    made = html.escape(json.dumps(provenance()))
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        f"<title>The thesis's experiments</title><style>{STYLE}</style>",
        "<h1>The thesis's experiments, solved</h1>",
        table(rows),
        *(_section(number, solutions) for number in sorted({s.key[0] for s in solutions})),
        f"<hr><p><small>{made}</small></p></html>",
    ]
    return "\n".join(parts)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """A table of all rows, beside what the thesis prints."""
    head = "".join(f"<th>{heading}</th>" for heading, _, _ in COLUMNS) + "<th>converged</th>"
    body = "\n".join(f"<tr>{_cells(row)}</tr>" for row in rows)
    return f"<table><tr>{head}</tr>\n{body}</table>"


def _cells(row: dict[str, Any]) -> str:
    values = (_formatted(row[key], form) for _, key, form in COLUMNS)
    verdict = "<td>yes</td>" if row["converged"] else "<td class='no'>NO</td>"
    return "".join(f"<td>{html.escape(value)}</td>" for value in values) + verdict


def _formatted(value: Any, form: str) -> str:
    return "-" if value is None else format(value, form)


def _section(number: int, solutions: Sequence[Solved]) -> str:
    findings = "".join(f"<li>{html.escape(text)}</li>" for text in FINDINGS[number])
    own = [_case(solution) for solution in solutions if solution.key[0] == number]
    return f"<h2>Experiment {number}</h2><ul>{findings}</ul>" + "\n".join(own)


def _case(solution: Solved) -> str:
    drawn = (figures.trajectories, figures.verification, figures.power)
    images = "\n".join(embedded(draw(solution)) for draw in drawn)
    optima = ", ".join(f"{cost:.6g} ({count}x)" for cost, count, _ in solution.optima[:8])
    chosen = "".join(
        f"; {name} = {value:.6g}"
        for name, value in zip(
            solution.extremal.problem.parameters, solution.extremal.parameters, strict=True
        )
    )
    titles = html.escape(" and ".join(p.variant for p in solution.case.printed))
    return (
        f"<h3>{titles}</h3><p>Local optima, with how many of {solution.case.effort.starts} starts "
        f"came to them: {optima}; {solution.failed} failed{chosen}. "
        f"{solution.seconds:.1f} s.</p><div class='figures'>{images}</div>"
    )


def embedded(figure: Figure) -> str:
    """A figure as an image within a page."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=80)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f"<img alt='figure' src='data:image/png;base64,{data}'>"
