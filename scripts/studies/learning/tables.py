"""The study's results as tables. Seeds that do not walk are counted, never averaged over."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import fmean, median
from typing import TypeAlias

from agents.evaluate import bootstrap_interval, interquartile_mean
from scripts.studies.documents.markdown import count, percent, table
from scripts.studies.learning.rows import ABLATIONS, FIRST_EVENING, FRONT, LEARNED, SECTIONS
from scripts.studies.learning.trials import SeedResult, StudyRow, WalkFigures

#: The results of each row's seeds.
Results: TypeAlias = Mapping[StudyRow, Sequence[SeedResult]]

#: CoT over the optimum at the same speed, minus 1; None without one.
Gap: TypeAlias = Callable[[StudyRow, WalkFigures], float | None]

NONE = "-"

#: Columns of every table, after those that name the policy.
FIGURES = (
    *("seeds that walk", "starts that walk", "gap to the optimum", "CoT", "speed (m/s)"),
    *("falls", "slips"),
)

#: More columns of tables in which rows were trained in different ways.
EFFORT = ("minutes of one core", "steps")


def tables(results: Results, gap: Gap) -> dict[str, str]:
    """A table for every section that has a row."""
    sections = {}
    for section in SECTIONS:
        rows = {row: seeds for row, seeds in results.items() if row.table == section}
        if rows:
            commanded = section in (FRONT, FIRST_EVENING)
            names = ("learner", "commanded") if commanded else ("policy",)
            effort = EFFORT if section in (LEARNED, ABLATIONS) else ()
            head = [*names, *FIGURES, *effort]
            lines = [line for each in rows.items() for line in _lines(*each, gap, commanded)]
            sections[section] = table(head, [line[: len(head)] for line in lines])
    return sections


def _lines(
    row: StudyRow, seeds: Sequence[SeedResult], gap: Gap, commanded: bool
) -> list[list[str]]:
    """A line for each of a row's policies; where speeds are commanded, one more for all of them."""
    lines = []
    for which in seeds[0].policies:
        names = [row.title, which] if commanded else [", ".join(filter(None, (row.title, which)))]
        lines.append(names + _figures(row, which, seeds, gap))
    if commanded and len(lines) > 1:
        walking = sum(all(map(row.walks, seed.policies.values())) for seed in seeds)
        blank = [""] * (len(FIGURES) - 1)
        lines.append([row.title, "all of these", f"{walking} of {len(seeds)}", *blank])
    return lines


def _figures(row: StudyRow, which: str, seeds: Sequence[SeedResult], gap: Gap) -> list[str]:
    """The same policy (best kept, last, ...) of every seed of a row, in words."""
    policies = [seed.policies[which] for seed in seeds]
    walking = [each for each in policies if row.walks(each)]
    shares = [each.share for each in policies]
    gaps = [value for each in walking if (value := gap(row, each)) is not None]
    return [
        f"{len(walking)} of {len(policies)}",
        f"{percent(median(shares))} ({100 * min(shares):.0f} to {100 * max(shares):.0f})",
        _interval(gaps),
        _mean([each.cot for each in walking], 4),
        _mean([each.speed for each in walking], 3),
        percent(fmean(each.falls for each in policies)),
        percent(fmean(each.slips for each in policies)),
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
