"""Stages of a comparison: in which order they run, and that processes do not change a result."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from agents.comparison.running import completed, most_urgent_first

from agents.comparison.methods import methods
from agents.comparison.study import Setting, Study
from trajopt.processes import KilledError


@dataclasses.dataclass(frozen=True)
class Toy:
    """Sums what those before it found, and adds one."""

    name: str
    after: tuple[str, ...] = ()
    effort: float = 1.0
    fails: bool = False
    killed: bool = False

    def compete(self, arena: Arena) -> dict[str, Any]:
        if self.fails:
            raise ValueError(f"{self.name} went wrong")
        if self.killed:
            os.kill(os.getpid(), signal.SIGKILL)
        found = [json.loads((arena.out / f"{each}.json").read_text()) for each in self.after]
        return {"sum": 1 + sum(each["result"]["sum"] for each in found)}

    def rows(self, arena: Arena, result: dict[str, Any]) -> list[dict[str, Any]]:
        return []


TOYS = (
    Toy("d", ("b", "c")),
    Toy("a"),
    Toy("b", ("a",)),
    Toy("c", ("a",), effort=5.0),
    Toy("e", effort=3.0),
)


EXPECTED = {"d": 5, "a": 1, "b": 2, "c": 2, "e": 1}


def sums(out: Path, workers: int, toys: tuple[Toy, ...] = TOYS) -> dict[str, int]:
    found = completed(Arena(Study(), out, progress=False), toys, workers)
    return {name: result["sum"] for name, result in found.items()}


def test_what_is_waited_for_longest_is_first() -> None:
    assert [toy.name for toy in most_urgent_first(TOYS)] == ["a", "c", "e", "b", "d"]


@pytest.mark.parametrize("study", [Study(), Study(further=()), Study(further_timesteps=1)])
def test_all_entrants_wait_only_for_others_that_come_before_them(study: Study) -> None:
    order = most_urgent_first(entrants(study))
    names = [entrant.name for entrant in order]
    assert len(set(names)) == len(names) == len(entrants(study))
    for k, entrant in enumerate(order):
        assert set(entrant.after) <= set(names[:k])


def test_kept_results_are_not_found_again(tmp_path: Path) -> None:
    assert sums(tmp_path, 1) == EXPECTED
    broken = tuple(dataclasses.replace(toy, fails=True) for toy in TOYS)
    assert sums(tmp_path, 1, broken) == EXPECTED


def test_the_log_of_a_process_stopped_after_its_result_was_written_is_removed(
    tmp_path: Path,
) -> None:
    sums(tmp_path, 1)
    (tmp_path / "e.log").touch()
    assert sums(tmp_path, 1) == EXPECTED
    assert not list(tmp_path.glob("*.log"))


@pytest.mark.slow
def test_stages_side_by_side_find_what_they_find_one_after_the_other(tmp_path: Path) -> None:
    toys = tuple(dataclasses.replace(toy, fails=toy.name == "d") for toy in TOYS)
    with pytest.raises(ValueError, match="d went wrong"):
        sums(tmp_path, 2, toys)
    assert {"a", "b", "c"} <= {path.stem for path in tmp_path.glob("*.json")}
    assert sums(tmp_path, 2) == EXPECTED
    assert {path.name for path in tmp_path.glob("*.log")} <= {"d.log"}  # says what went wrong


@pytest.mark.slow
def test_a_stage_whose_process_is_killed_is_named_and_the_same_call_goes_on(tmp_path: Path) -> None:
    toys = tuple(dataclasses.replace(toy, killed=toy.name == "d") for toy in TOYS)
    with pytest.raises(KilledError, match=r"^d: its process was killed"):
        sums(tmp_path, 2, toys)
    assert {"a", "b", "c"} <= {path.stem for path in tmp_path.glob("*.json")}
    assert sums(tmp_path, 2) == EXPECTED
