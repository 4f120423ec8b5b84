"""The study's tables in a page."""

from __future__ import annotations

from pathlib import Path

from scripts.studies.learning import page
from scripts.studies.learning.rows import FIRST_EVENING, LEARNED

HEAD = ["| policy | CoT |", "| --- | --- |"]

PAGE = Path(__file__).resolve().parents[4] / "docs" / "learning.md"


def test_a_page_is_filled_the_same_way_twice(tmp_path: Path) -> None:
    text = tmp_path / "learning.md"
    text.write_text(PAGE.read_text())
    sections = {LEARNED: "| h |\n| --- |\n| a |", FIRST_EVENING: "| h |\n| --- |\n| b |"}
    titles = ["a", "b"]
    page.refresh(text, sections, titles)
    once = text.read_text()
    page.refresh(text, {LEARNED: sections[LEARNED]}, titles)
    assert text.read_text() == once
    assert "| a |" in once
    assert "| b |" in once


def test_a_row_without_new_results_keeps_its_lines() -> None:
    old = [*HEAD, "| clone | 1 |", "| PPO, best kept | 2 |", "| PPO, last | 3 |", "| gone | 4 |"]
    new = [*HEAD, "| evolution | 6 |", "| clone | 5 |"]
    titles = ["clone", "PPO", "evolution"]
    assert page.with_kept(new, old, titles) == [
        *HEAD,
        "| clone | 5 |",
        "| PPO, best kept | 2 |",
        "| PPO, last | 3 |",
        "| evolution | 6 |",
    ]


def test_a_line_belongs_to_the_longest_title_that_it_begins_with() -> None:
    new = [*HEAD, "| PPO, slow, last | 1 |", "| PPO, last | 2 |"]
    assert page.with_kept(new, new, ["PPO", "PPO, slow"]) == [
        *HEAD,
        "| PPO, last | 2 |",
        "| PPO, slow, last | 1 |",
    ]


def test_lines_under_another_head_do_not_stay() -> None:
    old = ["| policy | speed |", "| --- | --- |", "| PPO | 2 |"]
    new = [*HEAD, "| clone | 5 |"]
    assert page.with_kept(new, old, ["clone", "PPO"]) == new


def test_a_page_keeps_what_a_part_of_the_study_does_not_tell(tmp_path: Path) -> None:
    path, rest = (
        tmp_path / "page.md",
        "text\n<!-- study: learned -->\n{}\n<!-- end of learned -->\n",
    )
    path.write_text(rest.format("\n".join([*HEAD, "| clone | 1 |", "| PPO | 2 |"])))
    page.refresh(path, {LEARNED: "\n".join([*HEAD, "| clone | 5 |"])}, ["clone", "PPO"])
    wanted = rest.format("\n".join([*HEAD, "| clone | 5 |", "| PPO | 2 |"]))
    assert path.read_text() == wanted
