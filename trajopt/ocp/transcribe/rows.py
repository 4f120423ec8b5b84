"""What the rows of the nonlinear program mean, and reports of violated ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Violations below this are rounding.
NOTEWORTHY = 1e-9


@dataclasses.dataclass(frozen=True)
class Rows:
    """Constraints of one kind.

    Attributes:
        kind: "differential equation", "path constraint", "slack", "integral", "start constraint",
            "end constraint", "linkage", "total duration" or "boundary".
        phase: index of the phase, -1 for the problem as a whole.
        names: of the rows at one place; every place has the same.
        fractions: where the places are, as fractions of the phase's duration.
        degree: of the elements that the rows belong to, 0 if none.
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
    """A constraint that is violated.

    Attributes:
        kind: of constraint, see `Rows`; "bound" for bounds.
        name: of the row.
        phase: name of the phase; empty for the problem as a whole.
        time: from the phase's start (s).
        amount: of the violation.
    """

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
    """The worst row of every kind that is violated, worst first.

    Args:
        kinds: of all rows, in order.
        outside: by how much each row is violated.
        phases: the trajectory, for the times.
        problem: for the names.
    """
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
