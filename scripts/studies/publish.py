"""Copy a finished comparison's table, plots and policies into the documents and package.

The README gets the headline, with what docs/learning.md says over many seeds beside it, and
docs/comparison.md the whole table. Every policy gets a card that says what it is and how it walks.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from agents.cli.commandline import Parser
from agents.comparison.entrants import entrants
from agents.comparison.headline import headline
from agents.comparison.learned import Learned
from agents.comparison.study import Study
from agents.policy_files import read_record
from scripts.studies.documents.cards import card
from scripts.studies.documents.headline import COMMAND, HEADLINE
from scripts.studies.documents.markdown import marks, refresh, wanted
from scripts.studies.documents.over_seeds import over_seeds

ROOT = Path(__file__).resolve().parents[2]
COPIES = {
    "cot_against_speed.png": "docs/cot_against_speed.png",
    "learning_curves.png": "docs/learning_curves.png",
    "deviations.png": "docs/deviations.png",
    "return_maps.png": "docs/return_maps.png",
}
#: Policies that come with the package, by name; the folder is that of the entrant.
POLICIES = {
    "imitation": "imitation/clone.zip",
    "fine_tuned": "fine_tuned/best.zip",
    "ppo": "scratch/best.zip",
    "evolution": "evolution/best.zip",
    "distilled": "distilled/clone.zip",
}
PRETRAINED = ROOT / "agents" / "pretrained"
#: Sections that are written, and their pages.
PAGES = {HEADLINE: "README.md", "table": "docs/comparison.md"}
#: The page with the tables of many seeds.
LEARNING = "docs/learning.md"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    parser.add_argument("--study", type=Path, default=Path("runs/compare"), help="of make compare")
    study = parser.parse_args(arguments).study
    notes = [str(Path(source).with_name("train.json")) for source in POLICIES.values()]
    for source in ("table.md", *COPIES, *POLICIES.values(), *notes, "results.json"):
        if not (study / source).is_file():
            parser.error(f"{study / source} is missing: run make compare to its end first")
    around = marks(COMMAND, tuple(PAGES))
    for name, page in PAGES.items():
        parser.require_page(ROOT / page, around[name], wanted(COMMAND, (name,)))
    try:
        many = over_seeds((ROOT / LEARNING).read_text())
    except (OSError, ValueError) as error:
        parser.error(f"{LEARNING}: {error}")
    for target in COPIES.values():
        parser.require_file(ROOT / target)
    for name in POLICIES:
        parser.require_file(PRETRAINED / f"{name}.zip")
    cards = {name: _card(study, name, source) for name, source in POLICIES.items()}
    for source, target in COPIES.items():
        shutil.copyfile(study / source, ROOT / target)
    for name, source in POLICIES.items():
        shutil.copyfile(study / source, PRETRAINED / f"{name}.zip")
        (PRETRAINED / f"{name}.md").write_text(cards[name])
    results = json.loads((study / "results.json").read_text())
    sections = {
        HEADLINE: headline(results["table"], results["study"]["speed"], many) + "\n",
        "table": (study / "table.md").read_text(),
    }
    for name, page in PAGES.items():
        refresh(ROOT / page, around, {name: sections[name]})
    return 0


def _card(study: Path, name: str, source: str) -> str:
    """The card of a policy of the study."""
    results = json.loads((study / "results.json").read_text())
    training = json.loads((study / source).with_name("train.json").read_text())
    of = results["study"]
    title, at = next(
        (title, entrant.speed)
        for entrant in entrants(Study(**of))
        if isinstance(entrant, Learned)
        for title, file in entrant.shown.items()
        if source == f"{entrant.name}/{file}"
    )
    row = next(row for row in results["table"] if (row["policy"], row["at"]) == (title, at))
    machine = of["preset"] + (f" with {json.dumps(of['changes'])}" if of["changes"] else "")
    return card(name, read_record(study / source), row, machine, training["init"])
