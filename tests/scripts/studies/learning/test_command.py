"""The study's command line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from scripts.studies.learning import command
from scripts.studies.learning.rows import EXPLORATION, FIRST_EVENING
from tests.scripts.studies.learning.toys import toy

ROOT = Path(__file__).resolve().parents[4]
PAGE, README = ROOT / "docs" / "learning.md", ROOT / "README.md"


def test_mistakes_on_the_command_line_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.md"
    other.write_text("# Another page\n")
    out = ["--out", str(tmp_path / "out")]
    for arguments, told in (
        (["--docs", str(other)], "<!-- study: learned -->"),
        (["--docs", str(PAGE), "--quick"], "leave out --quick"),
        (["--docs", str(PAGE), "--headline", str(other)], "<!-- compare: headline -->"),
        (["--headline", str(README)], "add --docs"),
        (["--rows", "no_such_row"], "no_such_row"),
        (["--seeds", "0"], "at least 1"),
    ):
        with pytest.raises(SystemExit):
            command.main([*out, *arguments])
        (line,) = capsys.readouterr().err.splitlines()
        assert told in line
    assert other.read_text() == "# Another page\n"


def test_a_headline_gets_the_gaps_of_the_tables_and_nothing_else_of_its_page_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_gaits: None
) -> None:
    learning, readme = tmp_path / "learning.md", tmp_path / "README.md"
    told = re.search(r"\| evolution from scratch, best kept \|.*", PAGE.read_text())
    assert told
    cells = told[0].split(" | ")
    gap, walking = cells[3], cells[1]
    page = PAGE.read_text().replace(told[0], told[0].replace(gap, "+3.0 % (+2.0 to +4.0)"))
    learning.write_text(page)
    readme.write_text(README.read_text())
    monkeypatch.setattr(command, "ROWS", (toy("toy", EXPLORATION),))
    pages = ["--docs", str(learning), "--headline", str(readme)]
    out = ["--out", str(tmp_path / "out"), "--seeds", "1", "--workers", "1"]
    assert command.main([*out, *pages]) == 0
    assert "| a toy, best | 1 of 1 |" in learning.read_text()
    stale, new = f"{gap}, {walking} walk |", f"+3.0 % (+2.0 to +4.0), {walking} walk |"
    assert README.read_text().count(stale) == 1
    assert readme.read_text() == README.read_text().replace(stale, new)


def test_an_interrupted_command_says_that_the_same_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--out", str(tmp_path), "--seeds", "2", "--workers", "1", "--rows", "toy"]
    monkeypatch.setattr(command, "ROWS", (toy(stops_at=4),))
    assert command.main(arguments) == 130
    assert "the same command goes on" in capsys.readouterr().err
    monkeypatch.setattr(command, "ROWS", (toy("toy", FIRST_EVENING, period=0.04),))
    assert command.main(arguments) == 0
    assert "| a toy | best | 2 of 2 |" in capsys.readouterr().out
    assert (tmp_path / "toy_0" / "counted").read_text() == 10 * "0"
