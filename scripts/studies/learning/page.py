"""The study's results as tables of docs/learning.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scripts.studies.documents import markdown
from scripts.studies.documents.markdown import count, table
from scripts.studies.learning.rows import (
    CLONING,
    DISTURBED,
    EXPLORATION,
    FIRST_EVENING,
    FRONT,
    LEARNED,
    PRICE,
    SEEDS,
    THESIS,
)
from scripts.studies.learning.summary import Average, Everywhere, Line, Seed

SECTIONS = (LEARNED, PRICE, EXPLORATION, CLONING, THESIS, FRONT, DISTURBED, FIRST_EVENING)
MARKED = (*SECTIONS, SEEDS)
MARKS, WANTED = markdown.marks("study", MARKED), markdown.wanted("study", MARKED)

NONE = "-"

#: Of tables of policies that choose their own speed.
HEAD = [
    *("policy", "seeds that walk", "starts that walk", "gap to the optimum", "CoT", "speed (m/s)"),
    *("falls", "slips", "minutes of one core", "steps"),
]


def refresh(page: Path, sections: dict[str, str], titles: Sequence[str]) -> None:
    """Put sections between their marks; others stay, and so do lines of rows that have no new ones.

    Args:
        page: to write into.
        sections: name -> table.
        titles: of all rows, in the order of the tables.
    """
    published = page.read_text()
    merged = {}
    for name, new in sections.items():
        found = MARKS[name].search(published)
        old = found[0].splitlines()[1:-1] if found else []
        merged[name] = "\n".join(with_kept(new.splitlines(), old, titles)) + "\n"
    markdown.refresh(page, MARKS, merged)


def with_kept(new: Sequence[str], old: Sequence[str], titles: Sequence[str]) -> list[str]:
    """The lines of a new table, and those of an old one for rows that the new one lacks.

    Args:
        new: lines of the new table, with its head of two lines.
        old: those of the old one; of no use if its head is another.
        titles: of all rows, in the order of the table.
    """
    kept = old if list(old[:2]) == list(new[:2]) else ()
    lines = list(new[:2])
    for title in titles:
        lines += _of_row(title, new, titles) or _of_row(title, kept, titles)
    return lines


def _of_row(title: str, lines: Sequence[str], titles: Sequence[str]) -> list[str]:
    """A row's lines: their first column is its title, or its title and which of its policies.

    A title may be the beginning of another; then a line belongs to the longer one.
    """
    longer = tuple(other for other in titles if other.startswith(f"{title}, "))
    own = [line for line in lines if _names(line, (title,))]
    return [line for line in own if not _names(line, longer)]


def _names(line: str, titles: Sequence[str]) -> bool:
    """Whether the line is of one of the rows."""
    return line.startswith(tuple(f"| {title}{end}" for title in titles for end in (" |", ", ")))


def sections(
    lines: Sequence[Line], whole: Sequence[Everywhere], seeds: Sequence[Seed]
) -> dict[str, str]:
    """A table for every section that has a row."""
    found = {SEEDS: seeds_table(seeds)} if seeds else {}
    for section in SECTIONS:
        own = [line for line in lines if line.row.table == section]
        if own:
            if section in (FRONT, FIRST_EVENING):
                found[section] = commanded_table(own, whole)
            elif section == THESIS:
                found[section] = nearly_free_table(own)
            else:
                found[section] = learned_table(own)
    return found


def learned_table(lines: Sequence[Line]) -> str:
    """Policies for `RimlessWheel-v0`."""
    return table(HEAD, [_learned(line) for line in lines])


def seeds_table(seeds: Sequence[Seed]) -> str:
    """Seeds one by one, walking from enough starts or not."""
    head = ["policy", "seed", "starts that walk", "gap to the optimum", "CoT", "speed (m/s)"]
    rows = []
    for each in seeds:
        walk = each.policy
        gap = NONE if each.gap is None else f"{100 * each.gap:+.1f} %"
        rows.append(
            [_titled(each), str(each.seed), f"{100 * walk.share:.1f} %", gap]
            + [_figure(walk.cot, 4), _figure(walk.speed, 3)]
            + [_percent(walk.falls), _percent(walk.slips)]
        )
    return table([*head, "falls", "slips"], rows)


def nearly_free_table(lines: Sequence[Line]) -> str:
    """The same on a machine whose optimum costs next to nothing: a gap in percent says little."""
    rows = [[*_learned(line), _mean(line.above, 4)] for line in lines]
    return table([*HEAD, "CoT above the optimum"], rows)


def _learned(line: Line) -> list[str]:
    return [
        *(_titled(line), _seeds(line), _starts(line), _gap(line.gap), _mean(line.cot, 4)),
        *(_mean(line.speed, 3), _percent(line.falls), _percent(line.slips)),
        *(_minutes(line.minutes), count(line.steps)),
    ]


def commanded_table(lines: Sequence[Line], whole: Sequence[Everywhere]) -> str:
    """Policies for commanded speeds, and after each row how many seeds walk at all of them."""
    head = ["learner", "commanded", "seeds that walk", "starts that walk", "gap to the optimum"]
    head += ["CoT", "speed (m/s)", "falls", "slips", "minutes of one core", "steps"]
    rows = []
    for each in whole:
        own = [line for line in lines if line.row == each.row]
        for line in own:
            rows.append(
                [line.row.title, line.which, _seeds(line), _starts(line), _gap(line.gap)]
                + [_mean(line.cot, 4), _mean(line.speed, 3), _percent(line.falls)]
                + [_percent(line.slips), _minutes(line.minutes), count(line.steps)]
            )
        if len(own) > 1:
            seeds = f"{each.walking} of {each.seeds}"
            rows.append([each.row.title, "all of these", seeds, *[""] * (len(head) - 3)])
    return table(head, rows)


def _titled(of: Line | Seed) -> str:
    return ", ".join(part for part in (of.row.title, of.which) if part)


def _seeds(line: Line) -> str:
    return f"{line.walking} of {line.seeds}"


def _starts(line: Line) -> str:
    """The median seed, and the worst and the best one."""
    return f"{_percent(line.middle)} ({100 * line.least:.0f} to {100 * line.most:.0f})"


def _gap(gap: Average | None) -> str:
    if gap is None:
        return NONE
    return f"{100 * gap.mean:+.1f} % ({100 * gap.low:+.1f} to {100 * gap.high:+.1f})"


def _mean(figure: Average | None, digits: int) -> str:
    return NONE if figure is None else _figure(figure.mean, digits)


def _figure(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _minutes(minutes: float) -> str:
    return f"{minutes:.1f}"
