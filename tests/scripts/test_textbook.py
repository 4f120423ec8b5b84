"""The textbook's table, printed by scripts/textbook.py and quoted in docs/optimal-control.md."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from scripts import textbook

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "optimal-control.md"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["textbook.py", *arguments])
    return textbook.main()


def test_it_prints_a_row_for_each_problem_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "gear", "least_effort_move", "--elements", "4") == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    assert [row.split(" | ")[0] for row in rows] == ["| least effort move", "| gear"]
    assert all("4 of degree 4" in row for row in rows)


def test_what_does_not_converge_says_so_and_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("passive_wheel", "--scheme", "trapezoid", "--tolerance", "1e-12")
    assert run(monkeypatch, *arguments) == 1
    assert "mesh error" in capsys.readouterr().out


def test_unknown_problems_are_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        run(monkeypatch, "nonsense")
    assert "unknown problems: nonsense" in capsys.readouterr().err


def test_the_document_quotes_all_problems_with_their_answers() -> None:
    quoted = dict(re.findall(r"^\| ([\w ]+) \| (-?[\d.]+) \|", DOCUMENT.read_text(), re.MULTILINE))
    for example in textbook.PROBLEMS:
        assert float(quoted[example.name]) == pytest.approx(example.known(), rel=1e-8)
