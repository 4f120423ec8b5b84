"""A few rows of the results, which the README shows between two markers."""

from __future__ import annotations

import re
from typing import Any

from scripts.studies.benchmarks.results import Result, by_key, middle, rates, ratio
from scripts.studies.benchmarks.tables import size
from scripts.studies.documents.markdown import count, table

#: Our rows, and the peers that each is compared with.
ROWS = {
    "ours": ("CartPole-v1", "Acrobot-v1", "InvertedDoublePendulum-v5"),
    "ours-vector-1024": ("cartpole-vector-1024", "envpool-acrobot"),
    "ours-vector-16384": ("cartpole-vector-16384", "gymnax-acrobot-one", "gymnax-acrobot-all"),
}
BLOCK = re.compile(r"(<!-- benchmark: .*? -->\n).*?(<!-- end of benchmark -->)", re.DOTALL)

_END = """\
**The peers have other physics**: ours walks, with impacts located to rounding error and every joule
booked; theirs swing or balance, in fewer and larger steps. Medians of one run on {cpu}, {cores}
cores; ratios are within a round."""


def quote(run: dict[str, Any]) -> str:
    """The table and the note below it."""
    found, lines = by_key(run["results"]), []
    for ours, peers in ROWS.items():
        for key in (ours, *peers):
            if key in found:
                lines.append(_line(found[key], found.get(ours) if key in peers else None))
    head = ("", "environments", "steps/s", "ours / peer")
    machine = run["machine"]
    end = _END.format(cpu=machine["cpu"], cores=machine["cores"])
    return f"{table(head, lines)}\n\n{end}\n"


def quoted(readme: str, run: dict[str, Any]) -> str:
    """The README with new figures in its block, if it has one."""
    return BLOCK.sub(lambda marks: marks[1] + quote(run) + marks[2], readme)


def _line(result: Result, ours: Result | None) -> tuple[str, ...]:
    rate = count(middle(list(rates(result).values())))
    environments = "1, `gym.make`" if result["group"] == "single" else size(result)
    share = f"{ratio(ours, result):.2g}" if ours else ""
    return result["title"], environments, rate, share
