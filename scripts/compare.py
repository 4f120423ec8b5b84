#!/usr/bin/env python
"""Learned against optimal cost of transport: the main job.

Solves the optimal gait and the front of optimal gaits around its speed, holds the best one with
feedback, clones the feedback law, fine-tunes the clone with PPO, trains PPO from scratch for the
same budget, and measures them all in the same way. Writes results.json, table.md, two plots and
an animation. However it was stopped, the same command goes on, and ends with the same table.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from agents.compare import Comparison
from agents.interrupts import sigterm_is_ctrl_c
from agents.report import format_table
from agents.study import Study
from rimless_gym.params import PRESETS


def main(argv: list[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    default = Study()
    parser.add_argument("--out", type=Path, default=Path("runs/compare"), help="results' folder")
    parser.add_argument(
        "--preset",
        default=default.preset,
        help=f"one of {', '.join(PRESETS)}; gaits are shipped for the default only",
    )
    parser.add_argument("--speed", type=float, default=default.speed, help="of the gait (m/s)")
    parser.add_argument("--steps", type=int, default=default.steps, help="of the gait, per stride")
    parser.add_argument("--seed", type=int, default=default.seed, help="of everything random")
    parser.add_argument(
        "--timesteps",
        type=int,
        default=default.timesteps,
        help="control intervals of fine-tuning, and of training from scratch",
    )
    parser.add_argument(
        "--starts", type=int, default=default.starts, help="random starts of the gait's search"
    )
    parser.add_argument(
        "--front",
        type=float,
        nargs="+",
        default=default.front,
        help="speeds of the optimal front (m/s)",
    )
    arguments = parser.parse_args(argv)
    settings = {name: value for name, value in vars(arguments).items() if name != "out"}
    try:
        study = Study(**(settings | {"front": tuple(arguments.front)}))
        with sigterm_is_ctrl_c():
            results = Comparison(study, arguments.out).run()
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")
    except OSError as error:
        parser.exit(
            2,
            f"error: {error}: make room, or choose another --out; what was finished before is "
            "kept, and the same command goes on from there\n",
        )
    except KeyboardInterrupt:
        print(
            f"\ninterrupted: what was finished is kept in {arguments.out}; the same command goes on"
        )
        return 130
    print(format_table(results["table"]))
    print(f"\nresults, plots and the animation are in {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
