"""Measure every feedback law about several held gaits, all from the same starts.

Cost over the optimum, pushes, region of attraction, changed machines, slopes, noise, delay, a low
battery, decision time and Floquet multipliers. Every figure is kept in a file as soon as it is
known: after Ctrl-C or a kill, the same command goes on from there. What depends on a
file that has changed is measured again. With two workers and six laws it takes about 40 minutes.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough

from agents.cli.main import INTERRUPTED
from scripts.studies.commandline import Parser, terminated_like_ctrl_c, whole
from scripts.studies.documents.drawings import save
from scripts.studies.feedback_laws import drawing, page
from scripts.studies.feedback_laws.gaits import GAITS
from scripts.studies.feedback_laws.study import study
from trajopt.feedback import laws


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when all is done, 1 if a law failed, 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    keys = [held.key for held in GAITS]
    parser.add_argument("--out", type=Path, default=Path("runs/feedback"), help="folder")
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--laws", type=_some(laws.names), default=None, help="some laws, a,b,c; by default all"
    )
    parser.add_argument(
        "--gaits",
        type=_some(lambda: keys),
        default=keys,
        help=f"some of the gaits, a,b,c, of {', '.join(keys)}; by default all",
    )
    parser.add_argument("--quick", action="store_true", help="a trial with few short walks")
    parser.add_argument(
        "--docs", type=Path, help="a page, docs/feedback.md, to put tables and figures into"
    )
    options = parser.parse_args(arguments)
    folder = options.out / "quick" if options.quick else options.out
    parser.require_folder(folder, "results.json")
    if options.docs:
        if options.quick or options.laws not in (None, laws.names()) or options.gaits != keys:
            parser.error(
                f"--docs {options.docs}: the page is replaced as a whole, and this is a part of "
                "the study; leave out --docs, or --quick, --laws and --gaits"
            )
        for marks in page.MARKS.values():
            parser.require_page(options.docs, marks, page.WANTED)
    names = options.laws or laws.names()
    gaits = [held for held in GAITS if held.key in options.gaits]
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(folder):
            found = study(folder, gaits, names, options.workers, options.quick)
    except KeyboardInterrupt:
        print(
            f"\ninterrupted: what was measured is in {folder}; the same command goes on",
            file=sys.stderr,
        )
        return INTERRUPTED
    place = options.docs.parent if options.docs else folder
    for name, figure in drawing.figures(found).items():
        save(figure, place / name)
    if options.docs:
        page.refresh(options.docs, found)
    print("\n".join(page.sections(found).values()))
    for cell, error in found["errors"].items():
        print(f"{cell}: {error}", file=sys.stderr)
    return 1 if found["errors"] else 0


def _some(known: Callable[[], list[str]]) -> Callable[[str], list[str]]:
    """The type of an argument that is a list of known names with commas between them."""

    def parsed(text: str) -> list[str]:
        wanted = text.split(",")
        unknown = [name for name in wanted if name not in known()]
        if unknown:
            raise argparse.ArgumentTypeError(
                f"{', '.join(map(repr, unknown))}: choose from {', '.join(known())}"
            )
        return [name for name in known() if name in wanted]

    return parsed
