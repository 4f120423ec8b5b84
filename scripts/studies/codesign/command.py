"""Search the builds that the preset BUILDABLE was chosen from, and see which of them start.

It takes about half an hour of two cores, with progress bars. After an interruption, the same
command goes on from there.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough

from agents.cli.main import INTERRUPTED
from scripts.studies.codesign import page
from scripts.studies.codesign.campaign import campaign
from scripts.studies.commandline import Parser, terminated_like_ctrl_c, whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when all is done, 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/codesign"), help="folder")
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--docs", type=Path, help="a page, docs/machine.md, to put the tables and figures into"
    )
    options = parser.parse_args(arguments)
    parser.require_folder(options.out, "results.json")
    if options.docs:
        for marks in page.MARKS.values():
            parser.require_page(options.docs, marks, page.WANTED)
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(options.out):
            campaign(options.out, options.workers, options.docs)
            return 0
    except KeyboardInterrupt:
        print(f"\ninterrupted: what was found is in {options.out}; the same command goes on")
        return INTERRUPTED
