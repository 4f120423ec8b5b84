"""Measure how robust learned policies are, beside laws, in the columns of docs/feedback.md.

Sensor noise, delay, a low battery, pushes, slopes and other machines: nobody tells the policies of
any. It takes about a minute for each, and prints tables of docs/learning.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents.policy_files import PRETRAINED
from rimless_gym.command import INTERRUPTED
from rimless_gym.commands.commandline import Parser, terminated_like_ctrl_c
from rimless_gym.commands.feedback_laws.columns.changes import machines, nuisances, slopes
from rimless_gym.commands.feedback_laws.columns.pushes import pushes
from rimless_gym.commands.feedback_laws.sizes import FOR_A_TRIAL, FOR_FAST_LAWS
from rimless_gym.commands.robust_policies import page
from rimless_gym.commands.robust_policies.walkers import shown_name, walking
from trajopt.feedback import laws
from trajopt.files import jsonable

#: What is measured of every policy.
COLUMNS = {"nuisances": nuisances, "pushes": pushes, "slopes": slopes, "machines": machines}

#: Whom the page tells of: a law, its clone, what evolution found, and what learned disturbed.
DEFAULT = ("lqr", "imitation", "evolution", "distilled", "robust")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    parser.add_argument(
        "policies",
        nargs="*",
        metavar="POLICY",
        default=DEFAULT,
        help=f"a policy's file (.zip); one that comes with the package: {', '.join(PRETRAINED)}; "
        f"or a feedback law: {', '.join(laws.names())}",
    )
    parser.add_machine(None, "machine; by default a policy's own, and BUILDABLE for laws")
    parser.add_argument("--quick", action="store_true", help="a trial: shows only that all runs")
    parser.add_argument("--docs", type=Path, help="a page, docs/learning.md, to put tables into")
    options = parser.parse_args(arguments)
    given = parser.machine(options) if options.preset or options.params else None
    sizes = FOR_A_TRIAL if options.quick else FOR_FAST_LAWS
    if options.docs:
        if options.quick:
            parser.error(f"--docs {options.docs}: a page tells of no trials; leave out --quick")
        for marks in page.MARKS.values():
            parser.require_page(options.docs, marks, page.WANTED)
    found: dict[str, dict[str, Any]] = {}
    names = [shown_name(name) for name in options.policies]
    for name in names:
        if names.count(name) > 1:
            parser.error(f"two policies are called {name}: give one of the files another name")
    with parser.refusing():  # all of them, before the first is measured
        walkers = [walking(name, given) for name in options.policies]
    total = len(walkers) * len(COLUMNS)
    try:
        with (
            terminated_like_ctrl_c(),
            parser.refusing(),
            tqdm(total=total, desc="robustness") as bar,
        ):
            for one in walkers:
                found[one.name] = {}
                for column, measure in COLUMNS.items():
                    bar.set_postfix_str(f"{one.name}: {column}")
                    found[one.name][column] = jsonable(measure(one, sizes))
                    bar.update()
    except KeyboardInterrupt:
        print("\ninterrupted: nothing was written", file=sys.stderr)
        return INTERRUPTED
    tables = page.sections(found)
    if options.docs:
        page.refresh(options.docs, tables)
    print("\n\n".join(tables.values()))
    return 0
