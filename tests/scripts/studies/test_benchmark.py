"""The benchmark: ratios, the page that it writes, and what it measures of ours."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scripts.studies.benchmark import ours, run, swing_up
from scripts.studies.benchmark.page import page, quoted, ratio
from scripts.studies.benchmark.rows import OURS, ROWS, SINGLE, BenchmarkRow

ROOT = Path(__file__).parents[3]
PUBLISHED = json.loads((ROOT / "docs" / "benchmark.json").read_text())


def answers(*seconds: float, first: int = 0) -> dict[str, Any]:
    steps = [{"round": first + i, "steps": 1, "seconds": s} for i, s in enumerate(seconds)]
    return {"answers": steps, "error": None}


def test_ratios_are_within_rounds_so_that_a_slow_round_does_not_matter() -> None:
    found = {"ours": answers(1.0, 10.0, 1.0), "peer": answers(2.0, 20.0, 2.0)}
    assert ratio(found, "ours", "peer") == 2.0
    assert ratio(found, "ours", "absent") is None
    assert ratio(found | {"late": answers(1.0, first=7)}, "ours", "late") is None


def test_the_published_page_and_readme_are_those_of_the_published_numbers() -> None:
    assert (ROOT / "docs" / "benchmark.md").read_text() == page(PUBLISHED)
    readme = (ROOT / "README.md").read_text()
    assert readme == quoted(readme, PUBLISHED)


@pytest.mark.parametrize("key", [row.key for row in ROWS])
def test_the_page_can_be_written_without_any_one_row(key: str) -> None:
    rest = [result for result in PUBLISHED["results"] if result["key"] != key]
    page(PUBLISHED | {"results": rest})
    failed = {"key": key, "answers": [], "error": "no network"}
    assert "no network" in page(PUBLISHED | {"results": [*rest, failed]})


def test_other_rows_are_measured_after_one_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [BenchmarkRow(key, SINGLE, key, OURS, "single") for key in ("good", "bad")]

    def measured(row: BenchmarkRow, seconds: float) -> dict[str, Any]:
        if row.key == "bad":
            raise RuntimeError("cannot be installed here")
        return {"steps": 1, "seconds": seconds}

    monkeypatch.setattr(run, "measured", measured)
    good, bad = run.measure_all(rows, 2, 0.5)
    assert [answer["round"] for answer in good["answers"]] == [0, 1]
    assert bad["error"] == "cannot be installed here"


def test_every_peer_has_its_pinned_requirements() -> None:
    for row in ROWS:
        assert row.python == OURS or (run.HERE / "requirements" / f"{row.python}.txt").is_file()


def test_the_cart_pole_gains_the_work_of_its_force() -> None:
    def energy(x: Any) -> Any:
        cart, pole = swing_up.CART, swing_up.POLE
        _, angle, v, w = x
        along = v + swing_up.LENGTH * w * np.cos(angle)
        across = swing_up.LENGTH * w * np.sin(angle)
        height = -swing_up.LENGTH * np.cos(angle)
        kinetic = cart * v**2 / 2 + pole * (along**2 + across**2) / 2
        return kinetic + pole * swing_up.GRAVITY * height

    x, u, h = np.array([0.1, 0.7, -0.4, 1.3]), 3.0, 1e-6
    rate = np.array(swing_up.derivative(x, u, math.sin, math.cos))
    gained = (energy(x + h * rate) - energy(x - h * rate)) / (2 * h)
    assert gained == pytest.approx(u * x[2], rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in ROWS if row.python == OURS], ids=lambda r: r.key)
def test_our_rows_can_be_measured(row: BenchmarkRow, monkeypatch: pytest.MonkeyPatch) -> None:
    if row.settings.get("cold"):
        pytest.skip("compiles everything")
    ours_answer = run.measured(row, 0.1)
    assert ours_answer["seconds"] > 0.0
    assert ours_answer.get("replay_error", 0.0) <= ours.TOLERANCE
