"""The study `learning`: the tables of docs/learning.md."""

from __future__ import annotations

import functools
import math
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from statistics import fmean, median
from typing import NamedTuple, TypeAlias

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

from agents.cli.options import Count, MaybeCount, MaybePath, Several, chosen
from agents.evaluate import EPISODE, PROTOCOL, Protocol, bootstrap_interval, interquartile_mean
from agents.gaps import best_at_any_speed, gap_to_optimum, reward_rate
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.presets import BUILDABLE
from scripts.studies import publish
from scripts.studies.documents import markdown
from scripts.studies.documents.markdown import count, percent, table
from scripts.studies.learning.rows import FIRST_EVENING, FRONT, LEARNED, ROWS, SECTIONS
from scripts.studies.learning.trials import SeedResult, StudyRow, WalkFigures
from trajopt import Solution, pool
from trajopt.store import Store, jsonable, key

#: A row appears in a table once this many seeds have finished.
FEWEST = 3

#: The folder of the optimal gaits, in that of the study.
GAITS = "front"

#: The results of each row's seeds.
Results: TypeAlias = Mapping[StudyRow, Sequence[SeedResult]]


class Compared(NamedTuple):
    """A policy compared with optimal gaits; None without one."""

    gap: float | None = None  # of its CoT
    returned: float | None = None  # share of the best return of 20 s


#: A comparison of a row's policies.
Compare: TypeAlias = Callable[[StudyRow, WalkFigures], Compared]

NONE = "-"

#: Columns of a table with commands, after those that name the policy. Gaps are to the optimum at
#: the speed of the walk.
FIGURES = (
    *(publish.WALKING, "starts that walk", publish.GAP, "CoT", "speed (m/s)"),
    *("falls", "slips"),
)

#: Those of the other table: gaps are to the least cost at any speed.
LEARNED_FIGURES = (
    *(publish.WALKING, "starts that walk", publish.OVER_LEAST, "CoT", "speed (m/s)"),
    *("falls", "slips", "share of the best 20 s return", "minutes of one core", "steps"),
)


class SeedTask(NamedTuple):
    """One seed of a row."""

    row: StudyRow  # how it is trained and evaluated
    seed: int  # of everything random in the training

    @property
    def key(self) -> str:
        """Its name, and that of its folder."""
        return key(f"{self.row.name}_{self.seed}", row=self.row)


def learning(
    *,
    rows: Several = (),
    seeds: Count = 10,
    workers: MaybeCount = None,
    out: Path = Path("runs/study"),
    docs: MaybePath = None,
    headline: MaybePath = None,
) -> int:
    """Train and evaluate every learner over several seeds; the exit status is 1 if a seed failed.

    A task is one seed of one row. Its result is kept as soon as it is known, and trainings save
    their states: after Ctrl-C or a kill, the same command goes on. (A training of plain
    stable-baselines3 begins again.)

    Args:
        rows: to train; all by default.
        seeds: of every row: 0, 1, ...
        workers: processes; by default one for every core.
        out: folder of the study.
        docs: a page, docs/learning.md, whose tables get the lines of finished rows.
        headline: README.md, whose headline has the gaps of that page.
    """
    known = {row.name: row for row in ROWS}
    if headline and not docs:
        raise ValueError(f"--headline {headline}: needs --docs, the page with the tables")
    with Store(out, {"protocol": jsonable(PROTOCOL)}) as store:
        tasks = [
            SeedTask(known[name], seed)
            for name in chosen(rows, list(known))
            for seed in range(seeds)
        ]
        failures = completed(store, tasks, PROTOCOL, workers)
        results = finished(store, ROWS, seeds)
        sections = tables(results, functools.partial(compared_in, out / GAITS))
    print("\n\n".join(sections.values()))
    if docs:
        marks, page = markdown.marks("study", tuple(sections)), docs.read_text()
        written = {name: merged(marks[name], page, text) for name, text in sections.items()}
        markdown.refresh(docs, marks, written)
    if headline and docs:
        publish.refresh_headline(headline, docs)
    for task, failure in failures.items():
        print(f"{task.row.name} {task.seed}: {failure}", file=sys.stderr)
    return 1 if failures else 0


def completed(
    store: Store, tasks: Sequence[SeedTask], protocol: Protocol, workers: int | None
) -> dict[SeedTask, str]:
    """Run the tasks that have no result yet; what went wrong with some, by task.

    A task that needs a policy of another row waits until the tasks of that row are finished.
    """
    failures: dict[SeedTask, str] = {}
    work = functools.partial(ran, store, protocol)
    for depth in sorted({_depth(task.row) for task in tasks}):
        wave = [t for t in tasks if _depth(t.row) == depth and t.key not in store]
        with closing(pool.run(work, wave, workers, progress=f"study, wave {depth}")) as results:
            for task, result in results:
                if isinstance(result, str):
                    failures[task] = result
                else:
                    store.save(task.key, jsonable(result))
    return failures


def _depth(row: StudyRow) -> int:
    """How many rows have to be trained before, one after the other."""
    return max((1 + _depth(other) for other in row.trial.needs), default=0)


def ran(store: Store, protocol: Protocol, task: SeedTask) -> SeedResult | str:
    """Train and evaluate a seed; in words what went wrong, if something did."""
    others = {other.name: SeedTask(other, task.seed) for other in task.row.trial.needs}
    missing = [name for name, other in others.items() if other.key not in store]
    if missing:
        return f"needs a policy of {' and '.join(missing)}: run these rows first"
    folder = store.folder / task.key
    folders = {name: store.folder / other.key for name, other in others.items()}
    try:
        return task.row.trial.run(task.seed, folder, folders, protocol)
    except (TypeError, ValueError, RuntimeError, ArithmeticError) as error:
        return f"{type(error).__name__}: {error}"


def finished(store: Store, rows: Sequence[StudyRow], seeds: int) -> Results:
    """The results of the first seeds of each row, up to one that is missing; none of too few.

    So the number of a row's seeds is known, and none was chosen.
    """
    results: dict[StudyRow, list[SeedResult]] = {}
    for row in rows:
        finished_seeds: list[SeedResult] = []
        for seed in range(seeds):
            if (name := SeedTask(row, seed).key) not in store:
                break
            saved = store.load(name)
            policies = {
                which: WalkFigures(**{k: math.nan if v is None else v for k, v in each.items()})
                for which, each in saved["policies"].items()
            }
            finished_seeds.append(SeedResult(policies, saved["steps"], saved["minutes"]))
        if len(finished_seeds) >= min(FEWEST, seeds):
            results[row] = finished_seeds
    return results


def compared_in(folder: Path, row: StudyRow, figures: WalkFigures) -> Compared:
    """A policy and the environment's own optimum, whose gaits are kept in the folder.

    The optimum is the best gait at any speed; where speeds are commanded, that at the walk's own.
    There is no gap without a walk or a gait, and where actions are held for another time than the
    voltage of the optima.
    """
    walks = row.walks(figures)
    if row.trial.period != CONTROL_PERIOD:
        return Compared()
    if row.table == LEARNED:
        least = best_gait(folder)
        share = figures.returned / (EPISODE * reward_rate(least))
        return Compared(figures.cot / least.cot - 1.0 if walks else None, share)
    if not walks:
        return Compared()
    return Compared(gap_to_optimum(BUILDABLE, figures.cot, figures.speed, folder, progress=True))


@functools.cache
def best_gait(folder: Path) -> Solution:
    """The environment's own best gait at any speed, kept in the folder."""
    gait = best_at_any_speed(BUILDABLE, None, folder, progress=True)
    assert gait is not None  # the gaits of this machine are shipped
    return gait


# -- tables ----------------------------------------------------------------------------------------


def tables(results: Results, compare: Compare) -> dict[str, str]:
    """A table for every section that has a row."""
    sections = {}
    for section in SECTIONS:
        rows = {row: seeds for row, seeds in results.items() if row.table == section}
        if rows:
            commanded = section in (FRONT, FIRST_EVENING)
            names = ("learner", "commanded") if commanded else ("policy",)
            head = [*names, *(LEARNED_FIGURES if section == LEARNED else FIGURES)]
            lines = [line for each in rows.items() for line in _lines(*each, compare, commanded)]
            sections[section] = table(head, [line[: len(head)] for line in lines])
    return sections


def merged(marked: re.Pattern[str], page: str, new: str) -> str:
    """The lines of a page's table, those of a new one in place of its own."""
    found = marked.search(page)
    old = page[found.end(1) : found.start(2)] if found else ""
    names = new.splitlines()[0].split(" | ").index(FIGURES[0])
    lines = {}
    for line in (*old.splitlines(), *new.splitlines()):
        lines[tuple(line.split(" | ")[:names])] = line
    return "".join(f"{line}\n" for line in lines.values())


def _lines(
    row: StudyRow, seeds: Sequence[SeedResult], compare: Compare, commanded: bool
) -> list[list[str]]:
    """A line for each of a row's policies; where speeds are commanded, one more for all of them."""
    lines = []
    for which in seeds[0].policies:
        names = [row.title, which] if commanded else [", ".join(filter(None, (row.title, which)))]
        lines.append(names + _figures(row, which, seeds, compare))
    if commanded and len(lines) > 1:
        walking = sum(all(map(row.walks, seed.policies.values())) for seed in seeds)
        blank = [""] * (len(FIGURES) - 1)
        lines.append([row.title, "all of these", f"{walking} of {len(seeds)}", *blank])
    return lines


def _figures(row: StudyRow, which: str, seeds: Sequence[SeedResult], compare: Compare) -> list[str]:
    """The same policy (best kept, last, ...) of every seed of a row, in words."""
    policies = [seed.policies[which] for seed in seeds]
    walking = [each for each in policies if row.walks(each)]
    shares = [each.share for each in policies]
    compared = [compare(row, each) for each in policies]
    shares_of_best = [each.returned for each in compared if each.returned is not None]
    returned = [each for each in shares_of_best if math.isfinite(each)]
    return [
        f"{len(walking)} of {len(policies)}",
        f"{percent(median(shares))} ({100 * min(shares):.0f} to {100 * max(shares):.0f})",
        _interval([each.gap for each in compared if each.gap is not None]),
        _mean([each.cot for each in walking], 4),
        _mean([each.speed for each in walking], 3),
        percent(fmean(each.falls for each in policies)),
        percent(fmean(each.slips for each in policies)),
        percent(interquartile_mean(returned)) if returned else NONE,
        f"{median(seed.minutes for seed in seeds):.1f}",
        count(median(seed.steps for seed in seeds)),
    ]


def _interval(gaps: Sequence[float]) -> str:
    """The interquartile mean of gaps, and its 95 % bootstrap interval."""
    if not gaps:
        return NONE
    mean, (low, high) = interquartile_mean(gaps), bootstrap_interval(gaps)
    return f"{100 * mean:+.1f} % ({100 * low:+.1f} to {100 * high:+.1f})"


def _mean(values: Sequence[float], digits: int) -> str:
    """The interquartile mean of those that are numbers."""
    numbers = [value for value in values if not math.isnan(value)]
    return f"{interquartile_mean(numbers):.{digits}f}" if numbers else NONE
