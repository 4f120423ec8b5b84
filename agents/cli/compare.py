"""Learned against optimal cost of transport, at several speeds: the main job.

Solves the front of optimal gaits, with a free voltage and as the environment allows, holds the
latter with feedback, clones the feedback law, fine-tunes the clone with PPO, trains PPO and
evolution from scratch, and measures them all in the same way. Writes results.json, table.md, plots,
an animation, and report.html, in which tables can be sorted and plots hovered. Stages that need
nothing of each other run side by side. However it was stopped, the same command goes on, and ends
with the same table.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import Parser, more_than_zero, terminated_like_ctrl_c, whole
from agents.comparison.compare import Comparison
from agents.comparison.report import format_table
from agents.comparison.study import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser, default = Parser(__doc__), Study()
    parser.add_argument("--out", type=Path, default=Path("runs/compare"), help="results' folder")
    parser.add_machine(default.preset, "machine; BUILDABLE and THESIS_PHYSICAL have shipped gaits")
    parser.add_argument(
        "--speed", type=more_than_zero, default=default.speed, help="of all laws and clones (m/s)"
    )
    parser.add_argument(
        "--further",
        type=more_than_zero,
        nargs="*",
        default=default.further,
        help="speeds of the best law and its clone too (m/s)",
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
        "--further-timesteps",
        type=whole(0),
        default=default.further_timesteps,
        help="control intervals of fine-tuning at each of the further speeds, 50 s of a core for "
        f"{default.timesteps}",
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
        nargs=2,
        metavar=("LEAST", "GREATEST"),
        default=default.front,
        help="speeds of the optimal front (m/s)",
    )
    parser.add_argument(
        "--workers", type=whole(1), default=os.cpu_count(), help="processes that stages share"
    )
    parsed = parser.parse_args(arguments)
    parser.machine(parsed)
    options = vars(parsed)
    out, workers = options.pop("out"), options.pop("workers")
    parser.require_folder(out, "results.json", "table.md", "report.html", "page.html")
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(out):
            study = Study(changes=options.pop("params"), **options)
            results = Comparison(study, out, workers=workers).run()
    except KeyboardInterrupt:
        print(
            f"\ninterrupted: what was finished is kept in {out}; the same command goes on",
            file=sys.stderr,
        )
        return INTERRUPTED
    print(format_table(results["table"]))
    print(f"\nresults, plots and the animation are in {out}; open {out / 'report.html'}")
    return 0
