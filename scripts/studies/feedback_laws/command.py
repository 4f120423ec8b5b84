"""Measure every feedback law about several held gaits, all from the same starts.

Cost over the optimum, pushes, random states, noise, delay, changed machines, decision time and
multipliers. Every figure is stored as soon as it is known: after Ctrl-C or a kill, the same command
continues from there. With two workers and six laws it takes about 40 minutes.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough

from scripts.studies.documents import markdown
from scripts.studies.documents.markdown import percent
from scripts.studies.feedback_laws.measures import GAITS, MEASURES, TIMING, Measurement, measured
from trajopt.feedback import laws
from trajopt.pool import run
from trajopt.store import Store, file_digest, key

#: The code of laws and measures: its digests are part of a result's key, so that what was measured
#: of other code is measured again.
CODE = sorted([*Path(laws.__file__).parents[1].rglob("*.py"), *Path(__file__).parent.glob("*.py")])


MARKS = markdown.marks("feedback", ("gaits",))

#: The columns, and how each is written from the results of a law about a gait.
COLUMNS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "over the optimum (95 %)": lambda row: _interval(row["cost"], "gap", "+.2f"),
    "starts that walk (95 %)": lambda row: _interval(row["cost"], "share", ".0f"),
    "friction demand": lambda row: f"{row['cost']['friction_demand']:.2f}",
    "push backward (N s)": lambda row: f"{min(row['pushes']['backward']):.2f}",
    "push forward (N s)": lambda row: f"{min(row['pushes']['forward']):.2f}",
    "random states": lambda row: percent(row["random_states"]["share"]),
    "noise": lambda row: percent(row["disturbed"]["noise"]),
    "10 ms late": lambda row: percent(row["disturbed"]["delay"]),
    "machines ± 20 %": lambda row: percent(fmean(row["machines"].values())),
    "multiplier": lambda row: f"{row['multipliers']['sizes'][0]:.2f}",
    "decision (µs)": lambda row: f"{1e6 * row['decision']['batch']:.1f}",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when all is done, 1 if a law failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/feedback"), help="folder")
    parser.add_argument("--workers", type=int, help="processes; one for each core by default")
    parser.add_argument("--laws", nargs="+", choices=laws.names(), default=laws.names())
    parser.add_argument("--gaits", nargs="+", choices=list(GAITS), default=list(GAITS))
    parser.add_argument("--quick", action="store_true", help="a trial with few short walks")
    parser.add_argument(
        "--docs", type=Path, help="a page, docs/feedback.md, to put the tables into"
    )
    options = parser.parse_args(arguments)
    whole = options.laws == laws.names() and options.gaits == list(GAITS) and not options.quick
    if options.docs and not whole:
        parser.error("--docs replaces all tables; leave out --quick, --laws and --gaits")
    results, errors = study(
        options.out, options.gaits, options.laws, options.workers, options.quick
    )
    text = tables(results)
    if options.docs:
        markdown.refresh(options.docs, MARKS, {"gaits": text + "\n"})
    print(text)
    for name, error in errors.items():
        print(f"{name}: {error}", file=sys.stderr)
    return 1 if errors else 0


def study(
    folder: Path, gaits: Sequence[str], names: Sequence[str], workers: int | None, quick: bool
) -> tuple[dict[str, Any], dict[str, str]]:
    """The results by gait, law and measure, and the errors of those that could not be measured."""
    tasks = [
        Measurement(gait, law, measure, quick, folder)
        for gait in gaits
        for law in names
        for measure in MEASURES
    ]
    code = [file_digest(path) for path in CODE]
    keys = {
        task: key(
            f"{task.gait} {task.law} {task.measure}", gait=GAITS[task.gait], quick=quick, code=code
        )
        for task in tasks
    }
    results: dict[str, Any] = {gait: {law: {} for law in names} for gait in gaits}
    errors = {}
    with Store(folder) as store:
        # Decision times one at a time, or they would slow each other down.
        for timing, number in ((True, 1), (False, workers)):
            some = [task for task in tasks if (task.measure == TIMING) is timing]
            todo = [task for task in some if keys[task] not in store]
            for task, result in run(measured, todo, number, progress="feedback laws"):
                if "error" in result:  # of one law: others continue
                    errors[f"{task.gait}, {task.law}, {task.measure}"] = result["error"]
                else:
                    store.save(keys[task], result)
        for task in tasks:
            if keys[task] in store:
                results[task.gait][task.law][task.measure] = store.load(keys[task])
    return results, errors


def tables(results: Mapping[str, Any]) -> str:
    """A table of all laws for each gait."""
    parts = []
    for gait, rows in results.items():
        body = [
            [f"`{law}`", *(_cell(write, row) for write in COLUMNS.values())]
            for law, row in rows.items()
        ]
        parts.append(f"### {gait}\n\n{markdown.table(['law', *COLUMNS], body)}")
    return "\n\n".join(parts)


def _cell(write: Callable[[Mapping[str, Any]], str], row: Mapping[str, Any]) -> str:
    """A figure; a dash where the law does not walk, has none, or could not be measured."""
    try:
        return write(row)
    except (KeyError, TypeError):
        return "-"


def _interval(cost: Mapping[str, Any], name: str, form: str) -> str:
    """A mean and its interval, in percent."""
    low, high = cost[f"{name}_interval"]
    return f"{100 * cost[name]:{form}} % ({100 * low:{form}} to {100 * high:{form}})"
