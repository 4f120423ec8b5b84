"""Find the periodic gait of least cost of transport, verify it, report and save it."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import (
    DEFAULT_PRESET,
    Parser,
    more_than_zero,
    terminated_like_ctrl_c,
    whole,
)
from trajopt import Solution, periodic_gait

#: Speeds (m/s) that a report does not tell apart.
SAME = 5e-5

WHY = "no speed nearer to it lets a stride last a whole number of intervals"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if the gait passed verification, 1 if not, 2 if none was found."""
    parser = Parser(__doc__)
    parser.add_machine(DEFAULT_PRESET)
    parser.add_argument("--speed", type=more_than_zero, default=0.5, help="mean speed, m/s")
    parser.add_argument("--steps", type=whole(1), default=1, help="touchdowns per stride")
    parser.add_argument(
        "--regeneration", action="store_true", help="let the battery take energy back"
    )
    parser.add_argument(
        "--hold",
        type=more_than_zero,
        help="hold the voltage for so long (s), as the environment does for 0.01; the speed is "
        "then the nearest at which a stride lasts a whole number of such intervals",
    )
    parser.add_argument(
        "--starts",
        type=whole(0),
        help="random starts; by default none with --guess or where a shipped gait is of the "
        "same machine, else 24",
    )
    parser.add_argument("--seed", type=whole(0), default=0, help="of the random starts")
    parser.add_argument(
        "--guess",
        type=Path,
        help="a gait (.npz, from --out) of as many steps to start from, in place of shipped ones",
    )
    parser.add_argument("--workers", type=whole(1), default=1, help="processes")
    parser.add_argument("--out", type=Path, help="file to save the gait in (.npz)")
    parser.add_argument("--json", action="store_true", help="print figures as JSON")
    options = parser.parse_args(arguments)
    params = parser.machine(options)
    if options.out is not None:
        parser.require_file(options.out)
    try:
        with parser.refusing(), terminated_like_ctrl_c():
            guess = None if options.guess is None else Solution.load(options.guess)
            solution = periodic_gait(
                params,
                options.speed,
                options.steps,
                options.regeneration,
                hold=options.hold,
                starts=options.starts,
                seed=options.seed,
                guess=guess,
                workers=options.workers,
                progress=True,
            )
    except KeyboardInterrupt:
        print("\ninterrupted: nothing was written", file=sys.stderr)
        return INTERRUPTED
    try:  # a full disk must not lose the report, nor a closed pipe the file
        if options.out is not None:
            with parser.writing(options.out):
                solution.save(options.out)
    finally:
        tell(solution, options)
    return 0 if solution.verification.passed else 1


def tell(solution: Solution, options: argparse.Namespace) -> None:
    """Print the gait's figures."""
    if options.json:
        print(json.dumps(solution.to_dict(), indent=2))
        return
    print(solution.report())
    if abs(solution.speed - options.speed) > SAME:
        print(f"  speed asked for         {options.speed:g} m/s; {WHY}")
