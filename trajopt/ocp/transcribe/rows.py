"""Which constraint a row of the nonlinear program is, and how to say that it is violated."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from trajopt.ocp.pose.problem import Array, Problem
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Violations below this are rounding.
NOTEWORTHY = 1e-9


@dataclasses.dataclass(frozen=True)
class Rows:
    """Constraints of one kind.

    Attributes:
        kind: "differential equation", "path", "power", "linkage", ...
        phase: index of the phase, -1 for the problem as a whole.
        names: of the rows at one place, repeated over all places.
        fractions: of the phase's duration, one per place.
        degree: of the elements that they belong to, 0 if none.
        count: how many rows there are in all.
    """

    kind: str
    phase: int
    names: tuple[str, ...]
    fractions: Array
    degree: int
    count: int


@dataclasses.dataclass(frozen=True)
class Breach:
    """A constraint that is violated: which, where, when and by how much."""

    kind: str
    name: str
    phase: str
    time: float
    amount: float

    def __str__(self) -> str:
        """A line for a report."""
        where = f" of phase {self.phase!r} at t = {self.time:.6g} s" if self.phase else ""
        name = f" of {self.name}" if self.name else ""
        return f"{self.kind}{name}{where} violated by {self.amount:.1e}"


def breaches(
    kinds: Sequence[Rows],
    outside: Array,
    phases: Sequence[PhaseTrajectory],
    problem: Problem,
) -> tuple[Breach, ...]:
    """The worst row of every kind that is violated, by `outside`, worst first."""
    found, first = [], 0
    for rows in kinds:
        mine = outside[first : first + rows.count]
        first += rows.count
        if not len(mine) or mine.max() < NOTEWORTHY:
            continue
        worst = int(np.argmax(mine))
        place = min(worst // len(rows.names), len(rows.fractions) - 1)
        name, phase, time = rows.names[worst % len(rows.names)], "", 0.0
        if rows.phase >= 0:
            phase = problem.phases[rows.phase].name
            time = float(rows.fractions[place] * phases[rows.phase].duration)
        found.append(Breach(rows.kind, name, phase, time, float(mine[worst])))
    return tuple(sorted(found, key=lambda b: -b.amount))
