"""Measure what default episodes pay: baselines, laws, shipped policies, the front's best gait.

Every walker walks the 100 episodes that reset(seed=0) to reset(seed=99) begin, as gym.make gives
them. Prints the tables of docs/environment.md. It takes some ten minutes of one core, most
of it for the receding horizon and the design of the tuned law. What is measured is kept: after
Ctrl-C or a kill, the same command goes on from there. With names, only these walk, and the others'
lines stay as they were recorded beside the page.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import Parser, terminated_like_ctrl_c, whole
from scripts.studies.documents import marked
from scripts.studies.episode_returns import page
from scripts.studies.episode_returns.measure import EPISODES, everybody, renewed, returns
from trajopt.files import write_text

#: Beside the page: what its tables were made of.
RECORD = "returns.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="WALKER", help=f"one of {', '.join(everybody())}; none: all"
    )
    parser.add_argument("--episodes", type=whole(2), default=EPISODES, help="of every walker")
    parser.add_argument(
        "--docs",
        type=Path,
        help=f"a page, docs/environment.md, to put tables into; {RECORD} is written beside it",
    )
    parser.add_argument("--out", type=Path, default=Path("runs/returns"), help="folder")
    options = parser.parse_args(arguments)
    for name in options.names:
        if name not in everybody():
            parser.error(f"{name}: has no line; name some of {', '.join(everybody())}")
    if options.names and not options.docs:
        parser.error("name walkers only with --docs, the page whose other lines stay")
    parser.require_folder(options.out)
    if options.docs:
        for marks in page.MARKS.values():
            parser.require_page(options.docs, marks, page.WANTED)
        parser.require_file(options.docs.with_name(RECORD))
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(options.out):
            if options.names:
                recorded = json.loads(options.docs.with_name(RECORD).read_text())
                found = renewed(recorded, options.out, options.names)
            else:
                found = returns(options.out, options.episodes)
    except KeyboardInterrupt:
        print(f"\ninterrupted: what was measured is in {options.out}", file=sys.stderr)
        return INTERRUPTED
    tables = page.sections(found)
    if options.docs:
        text = json.dumps(found, indent=1) + "\n"
        write_text(options.docs.with_name(RECORD), text)
        marked.refresh(options.docs, page.MARKS, tables)
    print("\n".join(tables.values()))
    return 0
