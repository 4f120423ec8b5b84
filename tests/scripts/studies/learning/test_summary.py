"""What a table says of the seeds of a row."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from agents.statistics import interquartile_mean
from scripts.studies.learning import page
from scripts.studies.learning.running import completed
from scripts.studies.learning.summary import lines, one_by_one
from tests.scripts.studies.learning.toys import cells_of, toy


def test_the_table_counts_the_seeds_that_do_not_walk_and_averages_over_the_others(
    tmp_path: Path,
) -> None:
    results, _ = completed(tmp_path, cells_of(toy(standing=(1, 3)), 10), 1)
    best, last = lines(
        results, lambda row, policy: None if policy.cot is None else policy.cot / 0.05 - 1
    )
    assert (best.walking, best.seeds, last.walking) == (8, 10, 10)
    walking = [0.06 + 0.001 * seed for seed in range(10) if seed not in (1, 3)]
    assert best.cot is not None
    assert best.gap is not None
    assert best.cot.mean == pytest.approx(interquartile_mean(walking))
    assert best.gap.mean == pytest.approx(interquartile_mean(walking) / 0.05 - 1)
    assert best.gap.low < best.gap.mean < best.gap.high
    assert (best.least, best.middle, best.most) == (0.0, 1.0, 1.0)
    text = page.learned_table([best])
    assert "| a toy, best | 8 of 10 | 100 % (0 to 100) | +31.0 % (+" in text


def test_a_row_of_which_no_seed_walks_has_no_averages(tmp_path: Path) -> None:
    results, _ = completed(tmp_path, cells_of(toy(standing=(0, 1)), 2), 1)
    best, _ = lines(results, lambda row, policy: 0.1)
    assert (best.gap, best.cot, best.speed, best.walking) == (None, None, None, 0)
    assert "| a toy, best | 0 of 2 | 0 % (0 to 0) | - | - | - |" in page.learned_table([best])


def test_seeds_stand_one_by_one_whether_they_walk_or_not(tmp_path: Path) -> None:
    row = dataclasses.replace(toy(standing=(1,)), one_by_one=True)
    results, _ = completed(tmp_path, cells_of(row, 2), 1)
    found = one_by_one(results, lambda row, policy: 0.5 if policy.share else None)
    assert [(each.seed, each.gap) for each in found if each.which == "best"] == [
        (0, 0.5),
        (1, None),
    ]
    text = page.seeds_table(found)
    assert "| a toy, best | 0 | 100.0 % | +50.0 % | 0.0600 |" in text
    assert "| a toy, best | 1 | 0.0 % | - | - | - |" in text


def test_other_rows_have_no_seeds_one_by_one(tmp_path: Path) -> None:
    results, _ = completed(tmp_path, cells_of(toy(), 2), 1)
    assert one_by_one(results, lambda row, policy: None) == []
