"""Copy a finished comparison's table, plots and policies into the documents and the package.

The README gets the headline, with the figures over many seeds of docs/learning.md beside it, and
docs/comparison.md the whole table. Every policy gets a card. With --policy, a policy that is not of
the comparison is measured and put into the package, with a card, too.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.commanded import commands_within
from agents.comparison.methods import LearnedMethod, methods
from agents.comparison.study import Study
from agents.comparison.table import FRONT_POLICY, HEADLINE, SCREENED_PPO, Row, headline, policy_row
from agents.evaluate import evaluate
from agents.gaps import gap_to_optimum
from agents.policy_files import load_policy, read_record
from agents.reports import NONE, value_text
from rimless_gym import Task
from rimless_gym.envs import speed
from rimless_gym.envs.arguments import USUAL
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.presets import machine_name
from scripts.studies.documents import markdown

ROOT = Path(__file__).resolve().parents[2]
PRETRAINED = ROOT / "agents" / "pretrained"
PICTURES = ("cot_against_speed.png", "learning_curves.png")

#: Policies that come with the package, by name, in the folder of the study.
POLICIES = {
    "imitation": "imitation/clone.zip",
    "fine_tuned": "fine_tuned/best.zip",
    "ppo": "scratch/best.zip",
    "evolution": "evolution/best.zip",
    "distilled": "distilled/clone.zip",
}

#: Sections that are written, and their pages; the page with the tables over many seeds.
PAGES, LEARNING = {"headline": "README.md", "table": "docs/comparison.md"}, "docs/learning.md"
MARKS = markdown.marks("compare", tuple(PAGES))

#: Row of the comparison -> the cells with which its line in a table over many seeds begins.
STUDIED: Mapping[str, tuple[str, ...]] = {
    "imitation": ("imitation of the LQR",),
    "fine-tuned, best kept": ("imitation, fine-tuned by PPO, best kept",),
    FRONT_POLICY: ("imitation of a gain schedule", "0.56 m/s"),
    "evolution from scratch": ("evolution from scratch, best kept",),
    SCREENED_PPO: ("PPO from screened policies, best kept",),
    "PPO from scratch": ("PPO from scratch, best kept",),
}

#: Columns of the tables over many seeds.
WALKING, GAP = "seeds that walk", "gap to the optimum"

CARD = """\
# `{name}`: {title}

{origin}

| | |
| --- | --- |
{facts}

{figures}The figures are by the protocol of the README's table: 128 starts, 50 s each, measured over
the last 30 s{under}. {again}
`rimless evaluate {name}` measures this file.
"""

#: How the policies of the comparison, and others, are made again.
COMPARED = "`make compare` trains and measures it again;"
OTHERS = "docs/learning.md has the command that trains it;"

#: What a training began from, by the beginning of its description.
ORIGINS = {
    "imitation of evolution": "A network cloned from the evolved policy: no gait was given.",
    "imitation": "A clone of the LQR about the environment's own optimum.",
    "scratch": "Learned from nothing: no gait, no demonstration.",
}
COMMANDED_ORIGINS = ORIGINS | {
    "imitation": "A clone of LQRs about the environment's own optima at several speeds.",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", type=Path, default=Path("runs/compare"), help="of make compare")
    parser.add_argument("--policy", type=Path, help="a .zip in the folder of its training")
    parser.add_argument("--name", default="", help="of --policy in the package")
    parser.add_argument("--title", default="", help="of the card of --policy")
    options = parser.parse_args(arguments)
    try:
        if options.policy is None:
            publish_study(options.study)
        else:
            publish_policy(options.policy, options.name, options.title)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def publish_study(study: Path) -> None:
    """Publish a finished comparison.

    Raises:
        ValueError: the comparison is not finished, or a page lacks its marks or a line over seeds.
        OSError: a file cannot be written.
    """
    for name, page in PAGES.items():
        if not MARKS[name].search((ROOT / page).read_text()):
            raise ValueError(f"{page}: has no {markdown.wanted('compare', (name,))}")
    notes = [str(Path(source).with_name("train.json")) for source in POLICIES.values()]
    for source in ("results.json", "table.md", *PICTURES, *POLICIES.values(), *notes):
        if not (study / source).is_file():
            raise ValueError(f"{study / source}: is missing; run make compare to its end first")
    many = over_seeds((ROOT / LEARNING).read_text())
    results = json.loads((study / "results.json").read_text())
    rows = [Row(**row) for row in results["table"]]
    cards = {name: _card_of(study, name, source) for name, source in POLICIES.items()}
    for picture in PICTURES:
        shutil.copyfile(study / picture, ROOT / "docs" / picture)
    for name, source in POLICIES.items():
        shutil.copyfile(study / source, PRETRAINED / f"{name}.zip")
        (PRETRAINED / f"{name}.md").write_text(cards[name])
    sections = {
        "headline": headline(rows, results["study"]["speed"], many) + "\n",
        "table": (study / "table.md").read_text(),
    }
    for name, page in PAGES.items():
        markdown.refresh(ROOT / page, MARKS, {name: sections[name]})


def _card_of(study: Path, name: str, source: str) -> str:
    """The card of a policy of the study."""
    results = json.loads((study / "results.json").read_text())
    training = json.loads((study / source).with_name("train.json").read_text())
    config = results["study"]
    title, study_speed = next(
        (title, method.speed)
        for method in methods(Study(**config))
        if isinstance(method, LearnedMethod)
        for title, file in method.shown.items()
        if source == f"{method.name}/{file}"
    )
    rows = [Row(**row) for row in results["table"]]
    row = next(row for row in rows if (row.title, row.study_speed) == (title, study_speed))
    changes = f" with {json.dumps(config['changes'])}" if config["changes"] else ""
    machine = config["preset"] + changes
    return card(name, read_record(study / source), [row], machine, training["init"], COMPARED)


def publish_policy(file: Path, name: str, title: str) -> None:
    """Measure a policy that is not of the comparison, and put it into the package.

    Raises:
        ValueError: the name is no plain one or one of the comparison's, the policy walks from no
            start, or does not set a voltage every 10 ms, as the optimum does.
        OSError: a file cannot be read or written.
    """
    if not name.isidentifier() or name in POLICIES:
        raise ValueError(f"--name {name}: must be a plain name, not one of {', '.join(POLICIES)}")
    init = json.loads(file.with_name("train.json").read_text())["init"]
    policy = load_policy(file)
    control = policy.conditions.control
    if dataclasses.replace(control, speeds=None) != USUAL:
        raise ValueError(
            f"{file}: does not set a voltage every {CONTROL_PERIOD:g} s, as the optimum does; "
            f"train it with --control-period {CONTROL_PERIOD:g}"
        )
    commands = [None] if control.speeds is None else commands_within(*control.speeds)
    rows = []
    for command in commands:
        walks = evaluate(
            policy.policy,
            policy.params,
            command=command,
            control_period=CONTROL_PERIOD,
            progress=True,
        )
        gap = gap_to_optimum(policy.params, walks.cot, walks.speed, progress=True)
        rows.append(policy_row(title, walks.to_dict(), gap, command))
    if not any(row.walking_share for row in rows):
        raise ValueError(f"{file}: walks from no start; a card is of one that walks")
    text = card(name, read_record(file), rows, machine_name(policy.params), init, OTHERS)
    shutil.copyfile(file, PRETRAINED / f"{name}.zip")
    (PRETRAINED / f"{name}.md").write_text(text)


def card(
    name: str, record: Mapping[str, Any], rows: Sequence[Row], machine: str, init: str, again: str
) -> str:
    """The text of a policy's card.

    Args:
        name: of the policy in the package.
        record: of its file.
        rows: of the comparison's table, one; or one for each commanded speed.
        machine: name of its preset.
        init: what its training began from, in words.
        again: how it is made again, a sentence's first half.
    """
    speeds = record.get("speeds")
    usual = Task() if speeds is None else speed.TASK
    env = "RimlessWheel-v0" if speeds is None else "RimlessWheelSpeed-v0"
    drawn = {of: record[of] for of in ("ranges", "disturbances") if record.get(of) is not None}
    versions = ", ".join(f"{key} {value}" for key, value in record["versions"].items())
    facts = {
        "task": f"`{env}`, reward {_task(record['task'], usual)}",
        "machine": f"`{machine}`"
        + "".join(f", {of} {json.dumps(values)}" for of, values in drawn.items()),
        "algorithm": record["algo"],
        "steps": f"{record['timesteps']:,}" if record["timesteps"] else "none: only cloned",
        "seed": f"{record['seed']} (one seed; figures over seeds are in docs/learning.md)",
    }
    if speeds is None:
        facts |= _figures(rows[0])
    else:
        period = 1e3 * record["control_period"]
        facts["commands"] = f"{speeds[0]:g} to {speeds[1]:g} m/s, a decision every {period:g} ms"
    facts["made by"] = f"revision {str(record['git_revision'])[:10]} with {versions}"
    facts["licence"] = "MIT, as the rest of the package"
    origins = ORIGINS if speeds is None else COMMANDED_ORIGINS
    origin = (text for known, text in origins.items() if init.startswith(known))
    return CARD.format(
        name=name,
        title=rows[0].title,
        origin=next(origin, f"It began as: {init}."),
        facts="\n".join(f"| {name} | {value} |" for name, value in facts.items()),
        figures="" if speeds is None else _commanded_table(rows) + "\n\n",
        under="" if speeds is None else ", under one command each",
        again=again,
    )


def _commanded_table(rows: Sequence[Row]) -> str:
    """A line for each commanded speed."""
    shown = [name for name in _figures(rows[0]) if name != "return"]
    lines = [[f"{row.study_speed or 0.0:g} m/s", *map(_figures(row).get, shown)] for row in rows]
    return markdown.table(["commanded", *shown], lines)


def _figures(row: Row) -> dict[str, str]:
    """How a policy walks; a dash where it does not have a figure."""
    demand, force = row.friction_demand, row.min_normal_force_over_weight
    return {
        "starts that walk": value_text(row.walking_share, ".0%"),
        "CoT": value_text(row.cot, ".4f"),
        "return": value_text(row.objective, ".3f") + " m/s" * (row.objective is not None),
        "speed": value_text(row.speed, ".3f") + " m/s" * (row.speed is not None),
        "gap to the optimum at this speed": value_text(row.gap, "+.1%"),
        "friction demand, least Fy / weight": f"{value_text(demand, '.2f')}, "
        + value_text(force, ".2f"),
    }


def _task(fields: Mapping[str, Any], usual: Task) -> str:
    """What differs from the usual task."""
    registered = dataclasses.asdict(usual)
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
                texts.setdefault(title, f"{named[GAP]}, {named[WALKING]} walk")
    missing = [" | ".join(STUDIED[title]) for title in STUDIED if title not in texts]
    if missing:
        raise ValueError(f"no table has the lines {missing}: put them back, or study their rows")
    return texts
