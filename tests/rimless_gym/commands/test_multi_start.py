"""A search from many starts, run as scripts/multi_start.py runs it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import pytest

from rimless_gym.commands.multi_start import command

TROLLEY = """
from trajopt.ocp.problem import Phase
from trajopt.ocp.problem import Problem

def trolley(far=1.0):
    return Problem((Phase(
        "move", ("x", "v"), lambda x, u, p: [x[1], u[0]], ("f",), cost=lambda x, u, p: u[0] ** 2,
        bounds={"v": (0.0, 2.0)}, start={"x": 0.0, "v": 0.0}, end={"x": far, "v": 0.0},
        duration=1.0,
    ),))

def too_far():
    return trolley(5.0)
"""


Run: TypeAlias = Callable[..., int]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    (tmp_path / "trolleys.py").write_text(TROLLEY)
    monkeypatch.syspath_prepend(str(tmp_path))

    def run(problem: str, *options: str) -> int:
        return command.main([problem, "--workers", "1", "--out", str(tmp_path / "out"), *options])

    yield run
    sys.modules.pop("trolleys", None)


def test_the_best_optimum_is_reported_and_saved_with_its_picture(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("trolleys:trolley", "--starts", "4") == 0
    assert "from 4 start(s), 100.0%" in capsys.readouterr().out
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["best1.json", "best1.npz", "best1.png", "report.txt", "search.npz"]
    figures = json.loads((tmp_path / "out" / "best1.json").read_text())
    assert figures["cost"] == pytest.approx(12.0)


def test_the_same_command_goes_on_from_earlier_results(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    run("trolleys:trolley", "--starts", "2")
    run("trolleys:trolley", "--starts", "5")
    assert "3 starts in" in capsys.readouterr().out


def test_the_exit_status_says_that_nothing_was_found(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("trolleys:too_far", "--starts", "2") == 2
    assert "NO LOCAL OPTIMUM" in capsys.readouterr().out
