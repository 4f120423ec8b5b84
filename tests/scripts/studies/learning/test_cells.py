"""The cells of the study: what is kept of a seed, and when it is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from agents.protocol import PROTOCOL
from rimless_gym import THESIS_PHYSICAL
from scripts.studies.learning.cells import RESULT, kept
from scripts.studies.learning.running import completed
from tests.scripts.studies.learning.toys import cells_of, toy


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:30],
        lambda text: "[]",
        lambda text: "",
        lambda text: text.replace('"share": 1.0', '"share": 0.99'),
    ],
    ids=["cut", "list", "empty", "edited"],
)
def test_a_damaged_cell_is_refused_with_a_remedy(
    damage: Callable[[str], str], tmp_path: Path
) -> None:
    cells = cells_of(toy(), 2)
    completed(tmp_path, cells, 1)
    path = tmp_path / "toy_1" / RESULT
    path.write_text(damage(path.read_text()))
    remedy = f"remove it to judge its policies again, or remove {path.parent} to train them anew"
    with pytest.raises(ValueError, match="damaged") as refusal:
        completed(tmp_path, cells, 1)
    assert str(path) in str(refusal.value)
    assert remedy in str(refusal.value)
    path.unlink()
    assert len(completed(tmp_path, cells, 1)[0]) == 2
    assert (path.parent / "counted").read_text() == 10 * "1"  # it was not trained again


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"params": THESIS_PHYSICAL}, "params"),
        ({"protocol": dataclasses.replace(PROTOCOL, starts=4)}, "protocol"),
        ({"row": toy(standing=(7,))}, "trial"),
    ],
)
def test_a_cell_that_was_made_in_another_way_is_refused(
    changes: dict[str, Any], named: str, tmp_path: Path
) -> None:
    (cell,) = cells_of(toy(), 1)
    completed(tmp_path, [cell], 1)
    with pytest.raises(ValueError, match=rf"of another {named} .*choose another --out"):
        kept(tmp_path, dataclasses.replace(cell, **changes))
