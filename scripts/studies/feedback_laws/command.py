"""The study `feedback`: the tables of docs/feedback.md."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough

from tyro.conf import arg

from agents.cli.options import Flag, MaybeCount, MaybePath, Several, chosen
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


def feedback(
    *,
    out: Path = Path("runs/feedback"),
    workers: MaybeCount = None,
    names: Annotated[Several, arg(name="laws")] = (),
    gaits: Several = (),
    quick: Flag = False,
    docs: MaybePath = None,
) -> int:
    """Measure every feedback law about several held gaits, all from the same starts.

    Cost over the optimum, pushes, random states, noise, delay, changed machines, decision time and
    multipliers. Every figure is stored as soon as it is known: after Ctrl-C or a kill, the same
    command continues from there. With two workers and six laws it takes about 40 minutes. The exit
    status is 1 if a law could not be measured.

    Args:
        out: folder of the study.
        workers: processes; by default one for every core.
        names: laws; all by default.
        gaits: some of the study's; all by default.
        quick: make a trial with few short walks.
        docs: a page, docs/feedback.md, to put the tables into.
    """
    if docs and (names or gaits or quick):
        raise ValueError(
            f"--docs {docs}: all tables are new; leave out --quick, --laws and --gaits"
        )
    places = chosen(gaits, list(GAITS)), chosen(names, laws.names())
    results, errors = study(out, *places, workers, quick)
    text = tables(results)
    if docs:
        markdown.refresh(docs, MARKS, {"gaits": text + "\n"})
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
        for timing in (True, False):
            some = [task for task in tasks if (task.measure == TIMING) is timing]
            todo = [task for task in some if keys[task] not in store]
            # Decision times one at a time and here, or they would slow each other down.
            one_by_one = ((task, measured(task)) for task in todo)
            side_by_side = run(measured, todo, workers, progress="feedback laws")
            for task, result in one_by_one if timing else side_by_side:
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
