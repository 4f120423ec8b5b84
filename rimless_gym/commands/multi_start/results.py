"""What a search from many starts leaves in a folder."""

from __future__ import annotations

import json
from pathlib import Path

from trajopt.ocp.extremal import Extremal
from trajopt.ocp.multi_start import Search

#: Files of the search itself, from which it goes on, and of its report.
SEARCH, REPORT = "search.npz", "report.txt"


def write(search: Search, best: tuple[Extremal, ...], folder: Path) -> None:
    """Write the report, and the figures, trajectories and pictures of the best optima."""
    reports = [search.report(), *(extremal.report() for extremal in best)]
    (folder / REPORT).write_text("\n".join(reports) + "\n")
    for rank, extremal in enumerate(best, start=1):
        extremal.save(folder / f"best{rank}.npz")
        extremal.plot(folder / f"best{rank}.png")
        figures = json.dumps(extremal.to_dict(), indent=2)
        (folder / f"best{rank}.json").write_text(figures + "\n")
