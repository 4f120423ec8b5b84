"""The tables of the page of results."""

from __future__ import annotations

from collections.abc import Sequence

from scripts.studies.benchmarks.goals import GOALS
from scripts.studies.benchmarks.results import Result, middle, rates, ratio, values
from scripts.studies.documents.markdown import count, table


def goals_table(found: dict[str, Result]) -> str:
    """Every goal, and what was measured."""
    lines = []
    for goal in GOALS:
        figure = goal.measured(found)
        wanted = ("<= " if goal.at_most else ">= ") + goal.form.format(goal.bound)
        if goal.stretch is not None:
            wanted += f", stretch {goal.form.format(goal.stretch)}"
        if figure is None:
            lines.append((goal.title, wanted, "-", "not measured"))
            continue
        verdict = "**missed**"
        if goal.reached(figure, goal.bound):
            verdict = "reached"
        if goal.stretch is not None and goal.reached(figure, goal.stretch):
            verdict = "stretch reached"
        lines.append((goal.title, wanted, goal.form.format(figure), verdict))
    return table(("goal", "wanted", "measured", ""), lines)


def speed_table(
    results: Sequence[Result], found: dict[str, Result], reference: str, sizes: bool = False
) -> str:
    """Rates of one group.

    Args:
        results: of the group.
        found: all results, by key.
        reference: key of the row whose rate counts as 1.
        sizes: whether to show the number of environments and cores.
    """
    ours = middle(list(rates(found[reference]).values())) if reference in found else None
    lines = []
    for result in results:
        title = result["title"]
        name = [title, size(result)] if sizes else [title]
        if not result["answers"]:
            lines.append((*name, f"- ({result['error']})", "", "", result["physics"]))
            continue
        figures = list(rates(result).values())
        rate = middle(figures)
        spread = f"{count(min(figures))} to {count(max(figures))}"
        note = f" (stopped: {result['error']})" if result["error"] else ""
        share = f"{rate / ours:.3g}" if ours else "-"
        lines.append((*name, count(rate) + note, spread, share, result["physics"]))
    column = ("environments",) if sizes else ()
    ours_is = "rate, ours = 1" + (" (N = 1024)" if sizes else "")
    return table(("", *column, "steps/s", "spread", ours_is, "one step is"), lines)


#: Rows with one lane, and the same with eight.
EIGHT_LANES = {
    "one-lane": "ours",
    "one-lane-1024": "ours-vector-1024",
    "one-lane-16384": "ours-vector-16384",
}


def lanes_table(results: Sequence[Result], found: dict[str, Result]) -> str:
    """Rates with one lane beside those with eight."""
    lines = []
    for result in results:
        eight = found.get(EIGHT_LANES[result["key"]])
        with_eight = count(middle(list(rates(eight).values()))) if eight else "-"
        if not result["answers"]:
            lines.append((result["title"], with_eight, f"- ({result['error']})", "-"))
            continue
        with_one = count(middle(list(rates(result).values())))
        gain = f"{ratio(eight, result):.3g}" if eight else "-"
        lines.append((result["title"], with_eight, with_one, gain))
    return table(("", "steps/s, eight lanes", "steps/s, one lane", "eight / one"), lines)


def training_table(results: Sequence[Result]) -> str:
    """Shares of a learner's time."""
    lines = []
    for result in results:
        if not result["answers"]:
            lines.append((result["title"], f"- ({result['error']})", "", "", "", "", ""))
            continue
        shares, learning, logging = (
            values(result, name) for name in ("share", "learning", "logging")
        )
        evaluating = [s - a - b for s, a, b in zip(shares, learning, logging, strict=True)]
        parts = [f"{middle(part):.1%}" for part in (learning, logging, evaluating)]
        spread = f"{min(shares):.1%} to {max(shares):.1%}"
        speed = count(middle(list(rates(result).values())))
        lines.append((result["title"], f"{middle(shares):.1%}", spread, *parts, speed))
    head = ("stable-baselines3 PPO, one thread", "share", "spread")
    return table((*head, "roll-outs", "log", "evaluation", "steps/s in all"), lines)


def optimisation_table(results: Sequence[Result], found: dict[str, Result], reference: str) -> str:
    """Times to build and to solve one problem, and their ratios to those of a reference row.

    Args:
        results: of the group.
        found: all results, by key.
        reference: key of the row whose times count as 1.
    """
    lines = []
    for result in results:
        if not result["answers"]:
            blank = [""] * 6
            lines.append((result["title"], f"- ({result['error']})", *blank, result["physics"]))
            continue
        shares = ["-", "-"]
        if reference in found:
            shares = [f"{ratio(found[reference], result, of):.3g}" for of in ("solve", "total")]
        build, solve, iterations, cost = (
            values(result, name) for name in ("build", "solve", "iterations", "cost")
        )
        note = f" (stopped: {result['error']})" if result["error"] else ""
        lines.append(
            (
                result["title"],
                _time(middle(build)) + note,
                _time(middle(solve)),
                f"{_time(min(solve))} to {_time(max(solve))}",
                f"{middle(iterations):.0f}",
                f"{middle(cost):.2f}",
                *shares,
                result["physics"],
            )
        )
    head = ("", "build", "solve", "spread", "iterations", "cost", "solve, bare = 1")
    return table((*head, "build and solve, bare = 1", "by"), lines)


def process_table(results: Sequence[Result]) -> str:
    """Times that a fresh process takes, and memory."""
    lines = []
    for result in results:
        if not result["answers"]:
            lines.append((result["title"], f"- ({result['error']})"))
        elif "traced" in result["answers"][-1]:
            lines.append((result["title"], _memory(result)))
        else:
            seconds = values(result, "seconds")
            figure = f"{middle(seconds):.2f} s ({min(seconds):.2f} to {max(seconds):.2f})"
            lines.append((result["title"], figure))
    return table(("", "median (spread)"), lines)


def _memory(result: Result) -> str:
    answer = result["answers"][-1]
    traced, resident = answer["traced"] / 1024, answer["resident"] / 1024
    return f"{traced:.3g} KiB allocated, {resident:.3g} KiB resident ({answer['envs']} made)"


def size(result: Result) -> str:
    """The number of environments, and of cores."""
    n = result["settings"].get("n", result["about"].get("n", "-"))
    return f"{n}, {'one core' if result['one_core'] else 'all cores'}"


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1e3 * seconds:.3g} ms"
