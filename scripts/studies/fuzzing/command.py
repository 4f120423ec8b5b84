"""Step the compiled environment on random machines, and check every step.

Machines, states, voltages and disturbances are drawn from as wide a range as the environment
accepts. In each step the energies must balance, all numbers must be finite, the feet must stay
above the ground, and observations must lie in their space. Some intervals are integrated again by
the reference simulator, and some rows are compared with the single environment to the last bit. A
failure is printed as JSON: its seed, the machine, the state and the command. Ctrl-C prints what was
found so far. The exit status is 0 if nothing failed, 1 if something did, and 130 after Ctrl-C.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import Parser, more_than_zero, whole
from scripts.studies.fuzzing.campaign import Extent, campaign

STEPS = 20_000_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if nothing failed, 1 if something did, 130 after Ctrl-C."""
    parser = Parser(__doc__)
    extent = parser.add_mutually_exclusive_group()
    extent.add_argument("--steps", type=whole(1), default=STEPS, help="how many steps, of all rows")
    extent.add_argument("--seeds", type=whole(1), help="how many trials instead")
    extent.add_argument("--minutes", type=more_than_zero, help="how long instead")
    parser.add_argument("--seed", type=whole(0), default=0, help="of the first trial")
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count() or 1, help="processes")
    options = parser.parse_args(arguments)
    if options.seeds is not None:
        chosen = Extent(seeds=options.seeds)
    elif options.minutes is not None:
        chosen = Extent(seconds=60 * options.minutes)
    else:
        chosen = Extent(steps=options.steps)
    tally, interrupted = campaign(options.seed, chosen, options.workers)
    print(tally)
    if interrupted:
        return INTERRUPTED
    return 1 if tally.cases else 0
