"""Train and judge every learner over several seeds: the tables of docs/learning.md.

A cell is one seed of one row. Its result is kept as soon as it is known, and trainings keep their
own states: after Ctrl-C or a kill, the same command goes on. (A first evening of plain
stable-baselines3 begins again.) With --rows, only some rows are trained; the tables have all rows
of which the first three seeds are finished, and say how many seeds there are. A damaged result is
refused.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import DEFAULT_PRESET, Parser, terminated_like_ctrl_c, whole
from scripts.studies.documents import headline
from scripts.studies.learning import page
from scripts.studies.learning.rows import ROWS
from scripts.studies.learning.study import Study, run


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when all is done, 1 if a cell failed, 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    names = [row.name for row in ROWS]
    parser.add_argument("--seeds", type=whole(1), default=10, help="of every row: 0, 1, ...")
    parser.add_argument(
        "--rows", nargs="+", choices=names, default=names, metavar="ROW", help=", ".join(names)
    )
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=Path("runs/study"), help="folder")
    parser.add_machine(DEFAULT_PRESET)
    parser.add_argument(
        "--quick", action="store_true", help="a trial with few steps: shows only that all runs"
    )
    parser.add_argument("--docs", type=Path, help="a page, docs/learning.md, to put tables into")
    parser.add_argument(
        "--headline",
        type=Path,
        help="a page, README.md, whose headline gets the gaps over seeds; needs --docs",
    )
    options = parser.parse_args(arguments)
    study = Study(ROWS, options.seeds, parser.machine(options))
    folder = options.out
    if options.quick:
        study, folder = study.briefly(), folder / "quick"
    parser.require_folder(folder, "results.json")
    if options.docs:
        if options.quick:
            parser.error(f"--docs {options.docs}: a page tells of no trials; leave out --quick")
        for marks in page.MARKS.values():
            parser.require_page(options.docs, marks, page.WANTED)
    if options.headline:
        if not options.docs:
            parser.error(f"--headline {options.headline}: tells what --docs does; add --docs")
        marks = headline.MARKS[headline.HEADLINE]
        parser.require_page(options.headline, marks, headline.WANTED)
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(folder):
            found = run(study, options.rows, folder, options.workers)
    except KeyboardInterrupt:
        print(
            f"\ninterrupted: what was finished is in {folder}; the same command goes on",
            file=sys.stderr,
        )
        return INTERRUPTED
    if options.docs:
        page.refresh(options.docs, found.sections, [row.title for row in ROWS])
    print("\n\n".join(found.sections.values()))
    if found.unfinished:
        print(f"unfinished: {', '.join(found.unfinished)}", file=sys.stderr)
    for cell, failure in found.failures.items():
        print(f"{cell}: {failure}", file=sys.stderr)
    if options.headline:
        with parser.refusing():
            headline.refresh_gaps(options.headline, options.docs)
    return 1 if found.failures else 0
