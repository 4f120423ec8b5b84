#!/usr/bin/env python
"""Step the compiled environment on random machines, and check every step.

Machines, states, voltages and disturbances are drawn as wide as the environment takes them. Of each
step the energies must balance, numbers be finite, feet stay above the ground and observations in
their space; some intervals are integrated anew by the reference simulator, and some rows are
compared with the single environment to the last bit. A failure is printed as JSON: its seed, the
machine, the state and the command. Ctrl-C prints what was seen so far.

Exit status: 0 if nothing failed, 1 if something did, 130 after Ctrl-C.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.fuzzing.campaign import Extent, campaign


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    extent = parser.add_mutually_exclusive_group()
    extent.add_argument("--steps", type=_positive, default=20_000_000, help="default: 20000000")
    extent.add_argument("--seeds", type=_positive, help="how many trials instead")
    extent.add_argument("--minutes", type=_minutes, help="how long instead")
    parser.add_argument("--seed", type=int, default=0, help="of the first trial; default: 0")
    cores = os.cpu_count() or 1
    parser.add_argument(
        "--workers", type=_positive, default=cores, help=f"processes; default: {cores}"
    )
    arguments = parser.parse_args()
    if arguments.seed < 0:
        parser.error("--seed must be at least 0")
    if arguments.seeds is not None:
        chosen = Extent(seeds=arguments.seeds)
    elif arguments.minutes is not None:
        chosen = Extent(seconds=60 * arguments.minutes)
    else:
        chosen = Extent(steps=arguments.steps)
    tally, interrupted = campaign(arguments.seed, chosen, arguments.workers)
    print(tally)
    return 130 if interrupted else 1 if tally.cases else 0


def _positive(text: str) -> int:
    number = int(float(text)) if "e" in text else int(text)  # 20e6 is a number of steps
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return number


def _minutes(text: str) -> float:
    minutes = float(text)
    if not 0 < minutes < 1e6:
        raise argparse.ArgumentTypeError(f"{text} is no number of minutes")
    return minutes


if __name__ == "__main__":
    sys.exit(main())
