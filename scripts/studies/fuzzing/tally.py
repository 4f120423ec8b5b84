"""Counts and worst values of a fuzz, and the cases in which something was wrong."""

from __future__ import annotations

import dataclasses
import json
from typing import Any


@dataclasses.dataclass(frozen=True)
class Case:
    """Something that was wrong; ``scripts.studies fuzz --seed SEED --seeds 1`` shows it again.

    Attributes:
        seed: of the trial.
        trouble: what was wrong.
        step: of the trial, from 0; None if the trial as a whole failed.
        row: of the vector environment.
        params: the machine, fields of `WheelParams`.
        state: the hybrid state before the step.
        voltage: commanded, in units of the limit.
    """

    seed: int
    trouble: str
    step: int | None = None
    row: int | None = None
    params: dict[str, Any] | None = None
    state: list[float] | None = None
    voltage: float | None = None

    def __str__(self) -> str:
        return "FAILURE " + json.dumps(dataclasses.asdict(self))


@dataclasses.dataclass(frozen=True)
class Tally:
    """Counts and worst values. The sum of two tallies is the tally of both.

    Attributes:
        seeds: trials.
        steps: control intervals, of all rows together.
        ends: episodes that ended early.
        residual: the largest residual of a ledger, relative to the energies in it.
        reintegrated: intervals that were compared with the reference simulator.
        borderline: how many of them were borderline, see `reintegration`.
        difference: the largest difference of the others.
        twinned: steps of rows that were compared with the single environment.
        cases: the failures.
    """

    seeds: int = 0
    steps: int = 0
    ends: int = 0
    residual: float = 0.0
    reintegrated: int = 0
    borderline: int = 0
    difference: float = 0.0
    twinned: int = 0
    cases: tuple[Case, ...] = ()

    def __add__(self, other: Tally) -> Tally:
        worst = ("residual", "difference")
        both = {
            field.name: (max if field.name in worst else _sum)(
                getattr(self, field.name), getattr(other, field.name)
            )
            for field in dataclasses.fields(self)
        }
        return Tally(**both)

    def __str__(self) -> str:
        return (
            f"{self.steps:,} steps of {self.seeds:,} seeds, {self.ends:,} early ends: "
            f"worst residual {self.residual:.1e}, worst difference {self.difference:.1e} "
            f"({self.reintegrated:,} intervals compared with the reference, "
            f"{self.borderline:,} borderline), "
            f"{self.twinned:,} steps equal to the single environment, {len(self.cases):,} failures"
        )


def _sum(a: Any, b: Any) -> Any:
    return a + b
