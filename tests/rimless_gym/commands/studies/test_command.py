"""The study's command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from rimless_gym.commands.studies import command
from rimless_gym.commands.studies.rows import FIRST_EVENING
from tests.rimless_gym.commands.studies.toys import toy

PAGE = Path(__file__).resolve().parents[4] / "docs" / "learning.md"


def test_mistakes_on_the_command_line_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.md"
    other.write_text("# Another page\n")
    out = ["--out", str(tmp_path / "out")]
    for arguments, told in (
        (["--docs", str(other)], "<!-- study: learned -->"),
        (["--docs", str(PAGE), "--quick"], "leave out --quick"),
        (["--rows", "no_such_row"], "no_such_row"),
        (["--seeds", "0"], "at least 1"),
    ):
        with pytest.raises(SystemExit):
            command.main([*out, *arguments])
        (line,) = capsys.readouterr().err.splitlines()
        assert told in line
    assert other.read_text() == "# Another page\n"


def test_an_interrupted_command_says_that_the_same_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--out", str(tmp_path), "--seeds", "2", "--workers", "1", "--rows", "toy"]
    monkeypatch.setattr(command, "ROWS", (toy(stops_at=4),))
    assert command.main(arguments) == 130
    assert "the same command goes on" in capsys.readouterr().err
    monkeypatch.setattr(command, "ROWS", (toy("toy", FIRST_EVENING),))
    assert command.main(arguments) == 0
    assert "| a toy | best | 2 of 2 |" in capsys.readouterr().out
    assert (tmp_path / "toy_0" / "counted").read_text() == 10 * "0"
