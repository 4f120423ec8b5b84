"""Copy a finished comparison's table, plots and policies into the documents and the package.

The README gets the headline, with the figures over many seeds of docs/learning.md beside it, and
docs/comparison.md the whole table. Every policy gets a card.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.comparison.methods import LearnedMethod, methods
from agents.comparison.study import Study
from agents.comparison.table import (
    EVOLVED,
    FRONT_POLICY,
    FRONT_TUNED,
    HEADLINE,
    PPO_PRIOR,
    SAC_PRIOR,
    SAC_SCRATCH,
    Row,
    headline,
)
from agents.policy_files import read_record
from agents.reports import NONE, value_text
from rimless_gym import Task
from scripts.studies.documents import markdown

ROOT = Path(__file__).resolve().parents[2]
PRETRAINED = ROOT / "agents" / "pretrained"
PICTURES = ("cot_against_speed.png", "learning_curves.png")

#: Policies that come with the package, by name, in the folder of the study; those that it trained.
POLICIES = {
    "imitation": "imitation/clone.zip",
    "fine_tuned": "fine_tuned/last.zip",
    "evolution": "evolution/best.zip",
    "evolved": "evolved/best.zip",
}

#: Sections that are written, and their pages; the page with the tables over many seeds.
PAGES, LEARNING = {"headline": "README.md", "table": "docs/comparison.md"}, "docs/learning.md"
MARKS = markdown.marks("compare", tuple(PAGES))

#: Row of the comparison -> the cells with which its line in a table over many seeds begins.
STUDIED: Mapping[str, tuple[str, ...]] = {
    "imitation": ("imitation of the LQR",),
    "fine-tuned by CMA-ES": ("imitation, fine-tuned by CMA-ES",),
    FRONT_POLICY: (FRONT_TUNED, "0.62 m/s"),
    "evolution from scratch": ("evolution from scratch, best kept",),
    PPO_PRIOR: (PPO_PRIOR,),
    SAC_PRIOR: (SAC_PRIOR,),
    EVOLVED: (EVOLVED,),
    "PPO from scratch": ("PPO from scratch, best kept",),
    SAC_SCRATCH: ("SAC from scratch, best kept",),
}

#: Columns of the tables over many seeds.
WALKING, GAP, OVER_LEAST = "seeds that walk", "gap to the optimum", "over the least cost"

CARD = """\
# `{name}`: {title}

{origin}

| | |
| --- | --- |
{facts}

The figures are by the protocol of the README's table: 128 starts, 50 s each, measured over the last
30 s. `rimless compare --retrain --out runs/retrain` trains it again; `rimless evaluate {name}`
measures this file.
"""

#: What each of them comes from.
ORIGINS = {
    "imitation": "A clone of the LQR about the environment's own optimum.",
    "fine_tuned": "A clone of the LQR, whose last layer CMA-ES varied.",
    "evolution": "Learned from nothing: no gait, no demonstration.",
    "evolved": "A network cloned from an evolved policy near its own gait, and elsewhere from the\n"
    "start-up controller of that gait; CMA-ES varied its last layer. No gait was given.",
}


def publish(*, study: Path = Path("runs/compare")) -> int:
    """Publish a finished comparison.

    Args:
        study: folder of `make compare`.

    Raises:
        ValueError: the comparison is not finished, or a page lacks its marks or a line over seeds.
        OSError: a file cannot be written.
    """
    for name, page in PAGES.items():
        if not MARKS[name].search((ROOT / page).read_text()):
            raise ValueError(f"{page}: has no {markdown.wanted('compare', (name,))}")
    trained = {name: source for name, source in POLICIES.items() if (study / source).is_file()}
    for source in ("results.json", "table.md", *PICTURES):
        if not (study / source).is_file():
            raise ValueError(f"{study / source}: is missing; run make compare to its end first")
    many = over_seeds((ROOT / LEARNING).read_text())
    results = json.loads((study / "results.json").read_text())
    rows = [Row(**row) for row in results["table"]]
    cards = {name: _card_of(study, results, name) for name in trained}
    for picture in PICTURES:
        shutil.copyfile(study / picture, ROOT / "docs" / picture)
    for name, source in trained.items():
        shutil.copyfile(study / source, PRETRAINED / f"{name}.zip")
        (PRETRAINED / f"{name}.md").write_text(cards[name])
    sections = {
        "headline": headline(rows, results["study"]["speed"], many) + "\n",
        "table": (study / "table.md").read_text(),
    }
    for name, page in PAGES.items():
        markdown.refresh(ROOT / page, MARKS, {name: sections[name]})
    return 0


def _card_of(study: Path, results: Mapping[str, Any], name: str) -> str:
    """The card of a policy of the study."""
    source, config = POLICIES[name], results["study"]
    title = next(
        method.title
        for method in methods(Study(**config))
        if isinstance(method, LearnedMethod) and source == f"{method.name}/{method.file}"
    )
    row = next(Row(**row) for row in results["table"] if row["title"] == title)
    changes = f" with {json.dumps(config['changes'])}" if config["changes"] else ""
    machine = config["preset"] + changes
    return card(name, read_record(study / source), row, machine)


def card(name: str, record: Mapping[str, Any], row: Row, machine: str) -> str:
    """The text of a policy's card."""
    drawn = {of: record[of] for of in ("ranges", "disturbances") if record.get(of) is not None}
    versions = ", ".join(f"{key} {value}" for key, value in record["versions"].items())
    facts = {
        "task": f"`RimlessWheel-v0`, reward {_task(record['task'])}",
        "machine": f"`{machine}`"
        + "".join(f", {of} {json.dumps(values)}" for of, values in drawn.items()),
        "algorithm": record["algo"] if record["timesteps"] else "DAgger",
        "steps": f"{value_text(record.get('intervals'), ',')} of 10 ms in all",
        "seed": f"{record['seed']} (one seed; figures over seeds are in docs/learning.md)",
        **_figures(row),
        "made by": f"revision {str(record['git_revision'])[:10]} with {versions}",
        "licence": "MIT, as the rest of the package",
    }
    return CARD.format(
        name=name,
        title=row.title,
        origin=ORIGINS[name],
        facts="\n".join(f"| {name} | {value} |" for name, value in facts.items()),
    )


def _figures(row: Row) -> dict[str, str]:
    """How a policy walks; a dash where it does not have a figure."""
    demand, force = row.friction_demand, row.min_normal_force_over_weight
    return {
        "starts that walk": value_text(row.walking_share, ".0%"),
        "CoT": value_text(row.cot, ".4f"),
        "mean reward": value_text(row.objective, ".3f") + " m/s" * (row.objective is not None),
        "speed": value_text(row.speed, ".3f") + " m/s" * (row.speed is not None),
        "over the least CoT at any speed": value_text(row.over_least, "+.1%"),
        "over the best gait of 1 to 3 steps at this speed": value_text(row.gap, "+.1%"),
        "friction demand, least Fy / weight": f"{value_text(demand, '.2f')}, "
        + value_text(force, ".2f"),
    }


def _task(fields: Mapping[str, Any]) -> str:
    """What differs from the usual task."""
    registered = dataclasses.asdict(Task())
    changed = {name: value for name, value in fields.items() if value != registered[name]}
    return f"of {json.dumps(changed)}" if changed else "of the task as it is registered"


def refresh_headline(page: Path, learning: Path) -> None:
    """Fill the last column of the headline anew, from a page with tables over many seeds.

    Raises:
        ValueError: `page` has no headline, or a row is in no table of `learning`.
    """
    section = MARKS["headline"].search(page.read_text())
    if section is None:
        raise ValueError(f"{page}: has no {markdown.wanted('compare', ('headline',))}")
    many = over_seeds(learning.read_text())
    last = {meaning: many.get(title, NONE) for title, meaning in HEADLINE.items()}
    lines = []
    for line in section[0].splitlines()[1:-1]:
        cells = line.strip("| ").split(" | ")
        if cells[0] in last:
            line = "| " + " | ".join([*cells[:-1], last[cells[0]]]) + " |"
        lines.append(line)
    markdown.refresh(page, MARKS, {"headline": "\n".join(lines) + "\n"})


def over_seeds(page: str) -> dict[str, str]:
    """The gap over seeds, its interval, and how many seeds walk, for each row of the comparison.

    Args:
        page: the text of docs/learning.md.

    Raises:
        ValueError: a row of `STUDIED` is in no table of the page.
    """
    texts: dict[str, str] = {}
    head: list[str] = []
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split(" | ")]
        if not line.startswith("|"):  # the table has ended
            head = []
        elif WALKING in cells:
            head = cells
        for title, beginning in STUDIED.items():
            if cells[: len(beginning)] == [*beginning] and len(cells) == len(head):
                named = dict(zip(head, cells, strict=True))
                gap = named[OVER_LEAST if OVER_LEAST in named else GAP]
                walking = f"{named[WALKING]} walk"
                texts.setdefault(title, walking if gap == NONE else f"{gap}, {walking}")
    missing = [" | ".join(STUDIED[title]) for title in STUDIED if title not in texts]
    if missing:
        raise ValueError(f"no table has the lines {missing}: put them back, or study their rows")
    return texts
