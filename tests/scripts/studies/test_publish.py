"""A finished comparison comes into the README and the package as a whole."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from agents.comparison.entrants import entrants
from agents.comparison.headline import SHOWN
from agents.comparison.learned import Learned
from agents.comparison.study import Study
from agents.policy_files import PRETRAINED
from scripts.studies import publish
from scripts.studies.documents.over_seeds import STUDIED, over_seeds

#: What the factor of PPO from nothing may round to, in words.
NUMERALS = {14: "fourteen", 15: "fifteen", 16: "sixteen", 17: "seventeen", 18: "eighteen"}

ROW = {
    "walking_share": 1.0,
    "cot": 0.05,
    "speed": 0.6,
    "gap": 0.1,
    "friction_demand": 0.7,
    "min_normal_force_over_weight": 0.1,
}


#: What docs/learning.md says of every learner, with a table of other columns before.
HEAD = "| policy | seeds that walk | starts that walk | gap to the optimum |"
HEADED = [HEAD, "| --- | --- | --- | --- |"]
LEARNING = "\n".join(
    ["| policy | CoT |", "| --- | --- |", *[f"| {cells[0]} | 0.1 |" for cells in STUDIED.values()]]
    + HEADED
    + [f"| {cells[0]} | 9 of 10 | 99 % | +7 % |" for cells in STUDIED.values() if len(cells) == 1]
    + ["", HEAD.replace("policy", "learner | commanded"), "| --- | --- | --- | --- | --- |"]
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
        (folder / source).with_name("train.json").write_text('{"init": "scratch"}')
    for source in publish.COPIES:
        (folder / source).write_text(f"picture {source}")
    (folder / "table.md").write_text("| new table |\n")
    learned = [one for one in entrants(Study()) if isinstance(one, Learned)]
    table = [
        ROW | {"policy": title, "at": one.speed, "return": 0.25}
        for one in learned
        for title in one.shown
    ]
    table.append(ROW | {"policy": "LQR about the optimum", "at": 0.53, "gap": 0.2})
    table.append(ROW | {"policy": "LQR about the optimum", "at": Study().speed, "cot": None})
    of = dataclasses.asdict(Study(changes={"drag": 0.1}))
    (folder / "results.json").write_text(json.dumps({"study": of, "table": table}))
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


def test_the_table_the_pictures_and_the_policies_with_their_cards_are_published(
    study: Path, root: Path
) -> None:
    assert publish.main(["--study", str(study)]) == 0
    table = (root / "docs" / "comparison.md").read_text()
    assert table == section("table", "| new table |\n")
    for source, target in publish.COPIES.items():
        assert (root / target).read_text() == f"picture {source}"
    for name in publish.POLICIES:
        path = root / "agents" / "pretrained" / f"{name}.zip"
        assert path.read_bytes() == PRETRAINED[name].read_bytes()
        text = path.with_suffix(".md").read_text()
        assert text.startswith(f"# `{name}`: ")
        assert '| machine | `BUILDABLE with {"drag": 0.1}` |' in text
        assert "| CoT | 0.0500 |" in text


def test_the_headline_is_of_the_studys_own_speed_and_tells_what_does_not_walk(
    study: Path, root: Path
) -> None:
    publish.main(["--study", str(study)])
    lines = (root / "README.md").read_text().splitlines()[4:-2]
    assert [line.split(" | ")[1:] for line in lines] == [
        ["-", "+10.0%", "0.600", "100%", "- |"],
        *[["0.0500", "+10.0%", "0.600", "100%", "+7 %, 9 of 10 walk |"]] * 4,
    ]


def test_what_is_said_over_seeds_is_of_the_right_table_and_command() -> None:
    found = over_seeds(LEARNING)
    assert found["evolution from scratch"] == "+7 %, 9 of 10 walk"
    assert found["one policy for the front"] == "+2 %, 10 of 10 walk"
    assert found.keys() == STUDIED.keys()


def test_a_table_of_other_columns_is_not_read_under_the_head_of_the_one_before() -> None:
    title = "evolution from scratch, best kept"
    lines = LEARNING.replace(f"| {title} | 9 of 10 | 99 % | +7 % |\n", "")
    others = ["| policy | CoT | falls | slips |", "| --- | --- | --- | --- |"]
    with pytest.raises(ValueError, match=title):
        over_seeds("\n".join([*HEADED, "", *others, f"| {title} | 1 | 2 | 3 |", "", lines]))


def test_a_page_that_has_lost_a_line_of_the_study_is_refused(
    study: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lost = LEARNING.replace("| evolution from scratch, best kept | 9", "| evolution | 9")
    (root / publish.LEARNING).write_text(lost)
    with pytest.raises(SystemExit):
        publish.main(["--study", str(study)])
    assert "evolution from scratch, best kept" in capsys.readouterr().err
    assert "| old |" in (root / "README.md").read_text()


def test_the_published_headline_is_taken_from_the_published_table() -> None:
    whole = (publish.ROOT / "docs" / "comparison.md").read_text()
    rows = [line.strip("| ").split(" | ") for line in whole.splitlines() if line[:2] == "| "]
    known = {tuple(row[n] for n in (1, 4, 3, 5)) for row in rows if len(row) == 8}
    readme = (publish.ROOT / "README.md").read_text()
    shown = re.search(r"<!-- compare: headline -->\n(.*?)<!-- end of headline", readme, re.DOTALL)
    assert shown
    lines = [line.strip("| ").split(" | ") for line in shown[1].splitlines()[2:]]
    assert [line[0] for line in lines] == list(SHOWN.values())
    assert {tuple(line[1:5]) for line in lines} <= known
    told = over_seeds((publish.ROOT / publish.LEARNING).read_text())
    titles = dict(zip(SHOWN.values(), SHOWN, strict=True))
    assert [line[5] for line in lines] == [told.get(titles[line[0]], "-") for line in lines]


def test_what_the_readme_says_in_short_is_what_the_headline_says_over_seeds() -> None:
    readme = (publish.ROOT / "README.md").read_text()
    short = re.search(r"\*\*In short\*\*.*?\n\n", readme, re.DOTALL)
    assert short
    told = over_seeds((publish.ROOT / publish.LEARNING).read_text())
    names = ("imitation", "evolution from scratch", "PPO from screened policies")
    gaps = [float(told[name].split(" %")[0]) for name in names]
    said = [float(number) for number in re.findall(r"(\d+) %", short[0])]
    np.testing.assert_allclose(said, gaps, atol=0.5)
    times = 1.0 + float(told["PPO from scratch"].split(" %")[0]) / 100.0
    assert f"at {NUMERALS[round(times)]} times the optimum" in " ".join(short[0].split())


def test_publishing_twice_changes_nothing_more(study: Path, root: Path) -> None:
    publish.main(["--study", str(study)])
    once = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    publish.main(["--study", str(study)])
    assert {path: path.read_bytes() for path in root.rglob("*") if path.is_file()} == once


@pytest.mark.parametrize("name", publish.PAGES)
def test_a_page_without_marks_is_refused_before_anything_is_copied(
    study: Path, root: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    (root / publish.PAGES[name]).write_text("no table\n")
    with pytest.raises(SystemExit):
        publish.main(["--study", str(study)])
    assert f"<!-- compare: {name} -->" in capsys.readouterr().err
    left = {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}
    assert left == {*publish.PAGES.values(), publish.LEARNING}
