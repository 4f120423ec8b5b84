"""A planned catch in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trajopt import Solution
from trajopt.feedback import laws
from trajopt.feedback.catch import catch as catching
from trajopt.feedback.catch.catch_file import read_times, write_times
from trajopt.feedback.catch.grid import Values

COUNTS = (2, 3, 4, 5)


@pytest.fixture
def times() -> Values:
    rng = np.random.default_rng(0)
    return Values(rng.uniform(size=COUNTS), rng.uniform(size=(3, 5)))


def test_times_come_back_from_their_file(times: Values, tmp_path: Path) -> None:
    write_times(tmp_path / "catch.npz", times)
    again = read_times(tmp_path / "catch.npz", COUNTS)
    np.testing.assert_array_equal(again.single, times.single)
    np.testing.assert_array_equal(again.double, times.double)


def test_times_for_another_grid_are_refused_with_a_remedy(times: Values, tmp_path: Path) -> None:
    write_times(tmp_path / "catch.npz", times)
    with pytest.raises(ValueError, match=r"catch\.npz: .*delete it to plan the catch again"):
        read_times(tmp_path / "catch.npz", (2, 3, 4, 6))


def test_a_damaged_file_is_refused_with_a_remedy(times: Values, tmp_path: Path) -> None:
    path = tmp_path / "catch.npz"
    write_times(path, times)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match="delete it to plan the catch again"):
        read_times(path, COUNTS)


def test_a_catch_is_planned_once_for_all_processes(
    held: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    law, planned = laws.holding("lqr", held), list[object]()

    def to(law: object, near: float) -> object:
        planned.append(law)
        return original(law, near, counts=(5, 16, 11, 13))

    original = catching.Catch.to
    monkeypatch.setattr(catching, "COUNTS", (5, 16, 11, 13))
    monkeypatch.setattr(catching.Catch, "to", to)
    first = catching.catch_for(law, 0.6, tmp_path / "plans")
    catching._KEPT.clear()  # as in another process
    second = catching.catch_for(law, 0.6, tmp_path / "plans")
    assert len(planned) == 1
    x = np.array([[1.5, 0.2, -2.0, 1.0], [1.6, -2.0, -1.0, -9.0]])
    np.testing.assert_array_equal(first(x), second(x))
