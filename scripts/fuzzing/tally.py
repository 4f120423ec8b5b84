"""What a fuzz has seen so far, and the cases in which something was wrong."""

from __future__ import annotations

import dataclasses
import json
from typing import Any


@dataclasses.dataclass(frozen=True)
class Case:
    """Something that was wrong; ``scripts/fuzz.py --seed SEED --seeds 1`` shows it again.

    Attributes:
        seed: of the trial.
        trouble: what was wrong.
        step: of the trial, from 0; None: of the trial as a whole.
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
    """Counts and worst values; the sum of two is that of both.

    Attributes:
        seeds: trials.
        steps: control intervals, of all rows.
        ends: episodes that ended early.
        residual: the largest of a ledger, as a share of the energies in it.
        reintegrated: intervals compared with the reference simulator.
        borderline: those of them that go another way from a start next to theirs.
        difference: the largest in those that are not, see `scripts.fuzzing.reintegration`.
        twinned: steps of rows compared with the single environment.
        cases: in which something was wrong.
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
            f"({self.reintegrated:,} intervals integrated anew, {self.borderline:,} borderline), "
            f"{self.twinned:,} steps the same to the last bit alone, {len(self.cases):,} failures"
        )


def _sum(a: Any, b: Any) -> Any:
    return a + b
