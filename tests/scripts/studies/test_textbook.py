"""The table of scripts.studies textbook, quoted in docs/optimal-control.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from scripts.studies import textbook

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "optimal-control.md"


def test_it_prints_a_row_for_each_named_problem(capsys: pytest.CaptureFixture[str]) -> None:
    assert textbook.textbook(problems=("gear", "least_effort_move"), elements=4) == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    assert [row.split(" | ")[0] for row in rows] == ["| gear", "| least effort move"]
    assert all(row.split(" | ")[1:3] == [row.split(" | ")[1]] * 2 for row in rows)  # to 10 digits


def test_the_row_and_the_status_say_that_a_problem_did_not_converge(
    capsys: pytest.CaptureFixture[str],
) -> None:
    some = ("gear",)
    assert textbook.textbook(problems=some, scheme="trapezoid", tolerance=1e-12) == 1
    assert "mesh error" in capsys.readouterr().out


def test_unknown_problems_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="nonsense: unknown"):
        textbook.textbook(problems=("nonsense",))


def test_the_document_quotes_all_problems_with_their_answers() -> None:
    quoted = dict(re.findall(r"^\| ([\w ]+) \| (-?[\d.]+) \|", DOCUMENT.read_text(), re.MULTILINE))
    for example in textbook.PROBLEMS:
        assert float(quoted[example.name]) == pytest.approx(example.known(), rel=1e-8)
