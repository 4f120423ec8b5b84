"""Try why learning to walk from nothing is hard: short trials of the simplest policies.

What every steady voltage does, and which families of gaits random smooth policies find. It takes
about a minute, and prints the tables of docs/learning.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rimless_gym.command import INTERRUPTED
from rimless_gym.commands.commandline import DEFAULT_PRESET, Parser, terminated_like_ctrl_c, whole
from rimless_gym.commands.learning_trials import page
from rimless_gym.commands.learning_trials.trials import random, steady


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    parser.add_machine(DEFAULT_PRESET)
    parser.add_argument("--seed", type=whole(0), default=0, help="of starts and policies")
    parser.add_argument("--docs", type=Path, help="a page, docs/learning.md, to put tables into")
    options = parser.parse_args(arguments)
    params = parser.machine(options)
    if options.docs:
        for marks in page.MARKS.values():
            parser.require_page(options.docs, marks, page.WANTED)
    try:
        with terminated_like_ctrl_c(), parser.refusing():
            sections = {
                "steady": page.steady_table(steady(params, options.seed)),
                "random": page.random_table(random(params, options.seed)),
            }
    except KeyboardInterrupt:
        print("\ninterrupted: nothing was written", file=sys.stderr)
        return INTERRUPTED
    if options.docs:
        page.refresh(options.docs, sections)
    print("\n\n".join(sections.values()))
    return 0
