#!/usr/bin/env python
"""Learned against optimal cost of transport: the main job.

Solves the optimal gait and the front of optimal gaits around its speed, holds the one that the
environment allows with feedback, clones the feedback law, fine-tunes the clone with PPO, trains PPO
from scratch for the same budget, and measures them all in the same way. Writes results.json,
table.md, two plots and an animation. However it was stopped, the same command goes on, and ends
with the same table.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from agents.comparison.compare import Comparison
from agents.comparison.report import format_table
from agents.comparison.study import Study
from scripts.commandline import INTERRUPTED, Parser, more_than_zero, terminated_like_ctrl_c, whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser, default = Parser(__doc__), Study()
    parser.add_argument("--out", type=Path, default=Path("runs/compare"), help="results' folder")
    parser.add_machine(default.preset, "machine; BUILDABLE and THESIS_PHYSICAL have shipped gaits")
    parser.add_argument(
        "--speed", type=more_than_zero, default=default.speed, help="of the gait (m/s)"
    )
    parser.add_argument(
        "--steps", type=whole(1), default=default.steps, help="of the gait, per stride"
    )
    parser.add_argument("--seed", type=whole(0), default=default.seed, help="of everything random")
    parser.add_argument(
        "--timesteps",
        type=whole(0),
        default=default.timesteps,
        help="control intervals of fine-tuning",
    )
    parser.add_argument(
        "--scratch-timesteps",
        type=whole(0),
        default=default.scratch_timesteps,
        help="time steps of PPO from scratch, of 4 control intervals each",
    )
    parser.add_argument(
        "--evolution-timesteps",
        type=whole(0),
        default=default.evolution_timesteps,
        help="control intervals of evolution",
    )
    parser.add_argument(
        "--starts", type=whole(0), default=default.starts, help="random starts of the gait's search"
    )
    parser.add_argument(
        "--front",
        type=more_than_zero,
        nargs="+",
        default=default.front,
        help="speeds of the optimal front (m/s)",
    )
    parsed = parser.parse_args(arguments)
    parser.machine(parsed)
    options = vars(parsed)
    out = options.pop("out")
    parser.require_folder(out, "results.json", "table.md")
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(out):
            changes = {"changes": options.pop("params"), "front": tuple(options["front"])}
            study = Study(**options | changes)
            results = Comparison(study, out).run()
    except KeyboardInterrupt:
        print(
            f"\ninterrupted: what was finished is kept in {out}; the same command goes on",
            file=sys.stderr,
        )
        return INTERRUPTED
    print(format_table(results["table"]))
    print(f"\nresults, plots and the animation are in {out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
