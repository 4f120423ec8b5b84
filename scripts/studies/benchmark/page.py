"""The benchmark's page and its quotation in the README, which depend only on benchmark.json."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

from scripts.studies.benchmark.rows import OPTIMISATION, PROCESS, ROWS, SINGLE, VECTOR, BenchmarkRow
from scripts.studies.documents.markdown import count, table

INTRODUCTION = """\
# Speed, ours and the peers'

Written by `make bench`: do not edit. **The peers have other physics**: ours walks, with impacts
located to rounding error and every joule accounted for; theirs swing or balance, in fewer and
larger steps. What is compared is what a step of a small environment costs its user.

Everything was measured in one run on one computer, in turn, in {rounds} rounds of {seconds:g} s
each. Rates are medians, followed by the slowest and the fastest round; ratios are medians of ratios
within a round. Ours replays the actions that an LQR took on an optimal gait, or gets random
actions like the peers. Drawing actions and resetting are not timed, except that peers' vector
environments reset their rows within a step."""

OPTIMISATION_TEXT = """\
## Trajectory optimisation

Kelly's cart-pole swing-up (SIAM Review 2017) with 40 segments, from a straight line as the guess,
on one core. The least cost is 58.81 N^2 s. Building is everything from the equations to a solver
that is ready, without imports; solving is the rest. Costs differ a little where the discretisation
differs."""

PROCESS_TEXT = """\
## A fresh process

The very first time is that of compiling the simulator, about 200 functions. More than half of it is
numba's own work in Python; `rimless warmup` does all of it beforehand."""

#: Our rows in the README, and the peers that each is compared with.
QUOTED = {
    "ours": ("CartPole-v1", "Acrobot-v1", "InvertedDoublePendulum-v5"),
    "ours-random-1024": (),
    "ours-vector-1024": ("cartpole-vector-1024", "envpool-acrobot"),
    "ours-vector-16384": ("cartpole-vector-16384", "gymnax-acrobot-one"),
}
BLOCK = re.compile(r"(<!-- benchmark: .*? -->\n).*?(<!-- end of benchmark -->)", re.DOTALL)


def page(run: dict[str, Any]) -> str:
    """The whole page."""
    found = {result["key"]: result for result in run["results"]}

    def of(group: str) -> list[BenchmarkRow]:
        return [row for row in ROWS if row.group == group]

    computer, ours = run["machine"], run["versions"]
    answers = [answer for key in found for answer in answers_of(found, key)]
    versions = {answer[name] for answer in answers for name in answer if name.endswith("version")}
    parts = [
        INTRODUCTION.format(**run),
        "## One environment, as `gym.make` gives it, on one core",
        speed_table(of(SINGLE), found),
        "## Many environments",
        speed_table(of(VECTOR), found),
        OPTIMISATION_TEXT,
        optimisation_table(of(OPTIMISATION), found),
        PROCESS_TEXT,
        lines_table(of(PROCESS), found, ("median (spread)",), process_line),
        f"""## Computer and versions

{computer["cpu"]}, {computer["cores"]} cores, {computer["system"]}; load before \
{computer["load"]:.2f}; {run["date"]}; revision {run["git_revision"]}.

{", ".join(sorted(versions))}; numba {ours["numba"]}, numpy {ours["numpy"]}, \
Python {computer["python"]}.""",
    ]
    return "\n\n".join(parts) + "\n"


def speed_table(rows: Sequence[BenchmarkRow], found: dict[str, Any]) -> str:
    """Rates of one group."""

    def line(answers: list[dict[str, Any]], row: BenchmarkRow) -> tuple[str, ...]:
        size = f"{row.settings.get('n', 1)}, {'one core' if row.one_core else 'all cores'}"
        rates = [answer["steps"] / answer["seconds"] for answer in answers]
        spread = f"{count(min(rates))} to {count(max(rates))}"
        return (size, count(median(rates)), spread, row.by)

    return lines_table(rows, found, ("environments", "steps/s", "spread", "one step is"), line)


def optimisation_table(rows: Sequence[BenchmarkRow], found: dict[str, Any]) -> str:
    """Times to build and to solve one problem, and their ratios to those of the plain script."""

    def line(answers: list[dict[str, Any]], row: BenchmarkRow) -> tuple[str, ...]:
        build, solve = (median(a[name] for a in answers) for name in ("build", "solve"))
        ratios = [ratio(found, "swing-up-bare", row.key, of) for of in ("solve", "total")]
        shares = ["-" if each is None else f"{each:.3g}" for each in ratios]
        iterations, cost = (median(a[name] for a in answers) for name in ("iterations", "cost"))
        times = [f"{1e3 * each:.3g} ms" for each in (build, solve)]
        return (*times, f"{iterations:.0f}", f"{cost:.2f}", *shares, row.by)

    head = ("build", "solve", "iterations", "cost", "solve, script = 1", "both, script = 1", "by")
    return lines_table(rows, found, head, line)


def lines_table(
    rows: Sequence[BenchmarkRow],
    found: dict[str, Any],
    head: Sequence[str],
    line: Callable[[list[dict[str, Any]], BenchmarkRow], tuple[str, ...]],
) -> str:
    """A table with a line for each row; `line` makes its texts of the row's answers."""
    lines = []
    for row in rows:
        answers = answers_of(found, row.key)
        error = found[row.key]["error"] if row.key in found else None
        blank = (f"- ({error or 'not measured'})", *[""] * (len(head) - 1))
        lines.append((row.title, *(line(answers, row) if answers else blank)))
    return table(("", *head), lines)


def process_line(answers: list[dict[str, Any]], row: BenchmarkRow) -> tuple[str, ...]:
    """Seconds that a process took."""
    seconds = [answer["seconds"] for answer in answers]
    return (f"{median(seconds):.2f} s ({min(seconds):.2f} to {max(seconds):.2f})",)


def quoted(readme: str, run: dict[str, Any]) -> str:
    """The README with new figures in its block, if it has one."""
    found = {result["key"]: result for result in run["results"]}
    rows = {row.key: row for row in ROWS}
    lines = []
    for ours, peers in QUOTED.items():
        for key in (ours, *peers):
            if not (answers := answers_of(found, key)):
                continue
            rate = count(median(answer["steps"] / answer["seconds"] for answer in answers))
            share = ratio(found, ours, key) if key != ours else None
            row = rows[key]
            cores = "one core" if row.one_core else "all cores"
            size = f"{row.settings['n']}, {cores}" if row.group == VECTOR else "1, `gym.make`"
            lines.append((row.title, size, rate, "" if share is None else f"{share:.2g}"))
    head = ("", "environments", "steps/s", "ours / peer")
    computer = run["machine"]
    text = f"""{table(head, lines)}

Medians of one run on {computer["cpu"]}, {computer["cores"]} cores; ratios are within a round. **The
peers have other physics**: theirs swing or balance, in fewer and larger steps.
"""
    return BLOCK.sub(lambda marks: marks[1] + text + marks[2], readme)


def answers_of(found: dict[str, Any], key: str) -> list[dict[str, Any]]:
    """The answers of a row; none if it was not measured."""
    return list(found[key]["answers"]) if key in found else []


def ratio(found: dict[str, Any], ours: str, theirs: str, time: str | None = None) -> float | None:
    """How many times as fast ours is: the median of the ratios within rounds that have both.

    Ratios are taken within a round because the computer may be slower in another. `ours` and
    `theirs` are keys of rows, `time` names the time (s); by default it is that of a step.
    """

    def times(key: str) -> dict[int, float]:
        return {
            answer["round"]: answer[time] if time else answer["seconds"] / answer["steps"]
            for answer in answers_of(found, key)
        }

    mine, other = times(ours), times(theirs)
    ratios = [other[number] / mine[number] for number in mine.keys() & other.keys()]
    return median(ratios) if ratios else None
