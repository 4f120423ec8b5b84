"""A finished comparison comes into the documents and the package as a whole."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from agents.comparison.methods import LearnedMethod, methods
from agents.comparison.study import Study
from agents.comparison.table import HEADLINE, Row
from agents.policy_files import PRETRAINED, read_record
from scripts.studies import publish
from scripts.studies.publish import STUDIED, card, over_seeds

ROW = Row(
    *("PPO from scratch", None, 0.05, 0.25, 0.6, 0.1, 0.953, 0.714, 0.062, 0.2, 0.75),
    *("none", 250_000, 2.25),
)

RECORD: dict[str, Any] = {
    "task": {"distance_weight": 0.5},
    "ranges": None,
    "algo": "ppo",
    "timesteps": 1234567,
    "seed": 3,
    "git_revision": "0123456789abcdef",
    "versions": {"rimless-gym": "0.1.0", "torch": "2.13.0"},
}

#: docs/learning.md with a line for every learner, and a table of other columns before.
HEAD = "| policy | seeds that walk | starts that walk | over the least cost |"
COMMANDED = "| learner | commanded | seeds that walk | starts that walk | gap to the optimum |"
HEADED = [HEAD, "| --- | --- | --- | --- |"]
LEARNING = "\n".join(
    ["| policy | CoT |", "| --- | --- |", *[f"| {cells[0]} | 0.1 |" for cells in STUDIED.values()]]
    + HEADED
    + [f"| {cells[0]} | 9 of 10 | 99 % | +7 % |" for cells in STUDIED.values() if len(cells) == 1]
    + ["", COMMANDED, "| --- | --- | --- | --- | --- |"]
    + [
        f"| {' | '.join(cells)} | 10 of 10 | 99 % | +2 % |"
        for cells in STUDIED.values()
        if len(cells) == 2
    ]
)


def section(name: str, text: str) -> str:
    """A page with a section."""
    return f"before\n<!-- compare: {name} -->\n{text}<!-- end of {name} -->\nafter\n"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """What `make compare` leaves, of the policies that are shipped."""
    folder = tmp_path / "study"
    for name, source in publish.POLICIES.items():
        (folder / source).parent.mkdir(parents=True)
        shutil.copy(PRETRAINED[name], folder / source)
    for picture in publish.PICTURES:
        (folder / picture).write_text(f"picture {picture}")
    (folder / "table.md").write_text("| new table |\n")
    learned = [m for m in methods(Study(retrain=True)) if isinstance(m, LearnedMethod)]
    rows = [dataclasses.replace(ROW, title=method.title) for method in learned]
    for speed, cot in ((0.53, 0.05), (Study().speed, None)):
        rows.append(
            dataclasses.replace(
                ROW, title="LQR about the optimum", study_speed=speed, over_least=cot
            )
        )
    config = dataclasses.asdict(Study(changes={"drag": 0.1}, retrain=True))
    results = {"study": config, "table": [dataclasses.asdict(row) for row in rows]}
    (folder / "results.json").write_text(json.dumps(results))
    return folder


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with what is to be replaced."""
    root = tmp_path / "root"
    for folder in ("docs", "agents/pretrained"):
        (root / folder).mkdir(parents=True)
    for name, page in publish.PAGES.items():
        (root / page).write_text(section(name, "| old |\n"))
    (root / publish.LEARNING).write_text(LEARNING)
    monkeypatch.setattr(publish, "ROOT", root)
    monkeypatch.setattr(publish, "PRETRAINED", root / "agents" / "pretrained")
    return root


def contents(root: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_the_table_the_pictures_and_the_policies_with_their_cards_are_published(
    study: Path, root: Path
) -> None:
    assert publish.publish(study=study) == 0
    table = (root / "docs" / "comparison.md").read_text()
    assert table == section("table", "| new table |\n")
    for picture in publish.PICTURES:
        assert (root / "docs" / picture).read_text() == f"picture {picture}"
    for name in publish.POLICIES:
        path = root / "agents" / "pretrained" / f"{name}.zip"
        assert path.read_bytes() == PRETRAINED[name].read_bytes()
        text = path.with_suffix(".md").read_text()
        assert text.startswith(f"# `{name}`: ")
        assert '| machine | `BUILDABLE with {"drag": 0.1}` |' in text
        assert "| CoT | 0.0500 |" in text
    lines = (root / "README.md").read_text().splitlines()[4:-2]
    assert [line.split(" | ")[1:] for line in lines] == [
        ["none", "-", "75%", "95%", "0.25 M", "2.2", "- |"],  # of the study's own speed
        *[["none", "+20.0%", "75%", "95%", "0.25 M", "2.2", "+7 %, 9 of 10 walk |"]] * 5,
        ["none", *["-"] * 5, "+7 %, 9 of 10 walk |"],  # SAC from scratch, not in the comparison
    ]
    once = contents(root)
    publish.publish(study=study)
    assert contents(root) == once
    shutil.rmtree(study / "evolution")  # not trained, but taken from the package
    publish.publish(study=study)
    assert contents(root) == once


def test_nothing_is_published_into_pages_without_marks_or_without_a_line_over_seeds(
    study: Path, root: Path
) -> None:
    lost = LEARNING.replace("| evolution from scratch, best kept | 9", "| evolution | 9")
    for page, text, message in (
        (publish.LEARNING, lost, "evolution from scratch, best kept"),
        (publish.PAGES["table"], "none\n", "<!-- compare: table -->"),
    ):
        original = (root / page).read_text()
        (root / page).write_text(text)
        before = contents(root)
        with pytest.raises(ValueError, match=re.escape(message)):
            publish.publish(study=study)
        assert contents(root) == before
        (root / page).write_text(original)


def test_figures_over_seeds_are_of_the_right_table_and_command() -> None:
    found = over_seeds(LEARNING)
    assert found["evolution from scratch"] == "+7 %, 9 of 10 walk"
    assert found["one policy for the front"] == "+2 %, 10 of 10 walk"
    assert found.keys() == STUDIED.keys()
    title = "evolution from scratch, best kept"
    lines = LEARNING.replace(f"| {title} | 9 of 10 | 99 % | +7 % |\n", "")
    without_gap = LEARNING.replace("| +7 % |", "| - |")
    assert over_seeds(without_gap)["PPO from scratch"] == "9 of 10 walk"
    others = ["| policy | CoT | falls | slips |", "| --- | --- | --- | --- |"]
    with pytest.raises(ValueError, match=title):
        over_seeds("\n".join([*HEADED, "", *others, f"| {title} | 1 | 2 | 3 |", "", lines]))


def test_the_published_headline_is_taken_from_the_published_tables(root: Path) -> None:
    repository = Path(publish.__file__).parents[2]
    whole, readme, learning = (
        (repository / page).read_text()
        for page in ("docs/comparison.md", "README.md", publish.LEARNING)
    )
    rows = [line.strip("| ").split(" | ") for line in whole.splitlines() if line[:2] == "| "]
    known = {tuple(row[n] for n in (2, 3, 6)) for row in rows if len(row) == 9}
    shown = re.search(r"<!-- compare: headline -->\n(.*?)<!-- end of headline", readme, re.DOTALL)
    assert shown
    lines = [line.strip("| ").split(" | ") for line in shown[1].splitlines()[2:]]
    assert [line[0] for line in lines] == list(HEADLINE.values())
    assert {tuple(line[2:5]) for line in lines[:-1]} <= known  # the last is over seeds alone
    many = over_seeds(learning)
    assert [line[7] for line in lines] == [many.get(title, "-") for title in HEADLINE]
    studied = next(line[7] for line in lines if line[7] != "-")
    (root / "README.md").write_text(readme.replace(studied, "old"))
    (root / publish.LEARNING).write_text(learning)
    publish.refresh_headline(root / "README.md", root / publish.LEARNING)
    assert (root / "README.md").read_text() == readme


def test_a_card_has_the_figures_of_its_row_and_what_the_policy_comes_from() -> None:
    lines = card("evolution", RECORD, ROW, "BUILDABLE").splitlines()
    assert lines[:3:2] == ["# `evolution`: PPO from scratch", publish.ORIGINS["evolution"]]
    for line in (
        "| starts that walk | 95% |",
        "| CoT | 0.0500 |",
        "| mean reward | 0.250 m/s |",
        "| speed | 0.600 m/s |",
        "| over the best gait of 1 to 3 steps at this speed | +10.0% |",
        "| friction demand, least Fy / weight | 0.71, 0.06 |",
    ):
        assert line in lines
    falls = dataclasses.replace(ROW, cot=None, gap=None)
    assert "| CoT | - |" in card("evolution", RECORD, falls, "BUILDABLE").splitlines()


@pytest.mark.parametrize("name", publish.POLICIES)
def test_the_card_of_a_shipped_policy_is_that_of_its_file(name: str) -> None:
    shipped = PRETRAINED[name].with_suffix(".md").read_text().splitlines()
    record = read_record(PRETRAINED[name])
    lines = card(name, record, ROW, "BUILDABLE").splitlines()
    for field in ("task", "machine", "algorithm", "steps", "seed", "made by"):
        (line,) = [line for line in lines if line.startswith(f"| {field} |")]
        assert line in shipped
