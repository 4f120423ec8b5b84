"""Measure the speed of this package and of its peers in one run, in turn, and write the table.

Peers are other people's packages. Each runs in a virtual environment of its own, which is made the
first time; that takes a minute or two. If one cannot be installed, its row says so. Ctrl-C keeps
what was measured. Nothing else should run on the machine meanwhile.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from agents.cli.commandline import Parser, more_than_zero, whole
from scripts.studies.benchmarks.cases import CASES
from scripts.studies.benchmarks.driver import measure_all
from scripts.studies.benchmarks.machine import machine
from scripts.studies.benchmarks.page import page
from scripts.studies.benchmarks.quote import quoted
from trajopt.provenance import provenance

#: Where virtual environments, recordings and compiled code are kept for the next run.
KEPT = Path(__file__).resolve().parents[3] / "runs" / "bench"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    keys = [case.key for case in CASES]
    parser.add_argument("--rounds", type=whole(1), default=7, help="rounds over all rows")
    parser.add_argument("--seconds", type=more_than_zero, default=1.0, help="of each measurement")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="ROW",
        choices=keys,
        help=f"of {', '.join(keys)}; by default all",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=KEPT,
        help="folder for benchmark.md and benchmark.json; make bench writes to docs, and the "
        "README beside that folder then quotes the new figures",
    )
    parser.add_argument("--json", action="store_true", help="print everything, as JSON")
    options = parser.parse_args(arguments)
    readme = options.out.parent / "README.md"
    parser.require_folder(options.out, "benchmark.json", "benchmark.md")
    parser.require_folder(KEPT)
    if readme.exists():
        parser.require_file(readme)
    cases = [case for case in CASES if options.only is None or case.key in options.only]
    run = {
        "rounds": options.rounds,
        "seconds": options.seconds,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "machine": machine(),
        **provenance(),
    }
    run["results"] = measure_all(cases, options.rounds, options.seconds, KEPT)
    text = page(run)
    (options.out / "benchmark.json").write_text(json.dumps(run, indent=1) + "\n")
    (options.out / "benchmark.md").write_text(text)
    if readme.exists():
        readme.write_text(quoted(readme.read_text(), run))
    print(json.dumps(run, indent=1) if options.json else text)
    return 0
