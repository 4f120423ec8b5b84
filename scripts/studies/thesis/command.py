"""Solve the thesis's six experiments; write results.json and a report with its figures redrawn.

With --prototype, find out instead whether the machine as built can walk. That takes half an hour,
with a progress bar. After an interruption, the same command goes on from there.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import Parser, terminated_like_ctrl_c, whole
from scripts.studies.thesis.experiments import campaign as experiments
from scripts.studies.thesis.experiments import document
from scripts.studies.thesis.experiments.cases import EXPERIMENTS
from scripts.studies.thesis.prototype import campaign as prototype
from scripts.studies.thesis.prototype import page


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if every case converged, 1 if not, 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--experiment", type=int, choices=EXPERIMENTS, help="one of them; all by default"
    )
    what.add_argument(
        "--prototype", action="store_true", help="the machine as built, in place of the experiments"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/thesis"), help="folder to write to")
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--docs", type=Path, help="a page, docs/thesis.md, to put the table and figures into"
    )
    options = parser.parse_args(arguments)
    folder = options.out / ("prototype" if options.prototype else "unfinished")
    if options.prototype:
        parser.require_folder(folder, "results.json", "prototype.png")
    else:
        parser.require_folder(options.out, "results.json", "report.html", "page.html")
        parser.require_folder(folder)
    if options.docs:
        place = page if options.prototype else document
        parser.require_page(options.docs, place.MARKS, place.WANTED)
        parser.require_folder(place.figures_of(options.docs), "results.json")
    numbers = [options.experiment] if options.experiment else list(EXPERIMENTS)
    try:
        with terminated_like_ctrl_c():
            if options.prototype:
                prototype.campaign(folder, options.workers, options.docs)
                return 0
            converged = experiments.campaign(
                numbers, options.out, folder, options.workers, options.docs
            )
            return 0 if converged else 1
    except KeyboardInterrupt:
        print(f"\ninterrupted: what was found is in {folder}; the same command goes on from there")
        return INTERRUPTED
