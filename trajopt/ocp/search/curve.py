"""A curve of solutions along a parameter, and why it ends."""

from __future__ import annotations

import dataclasses

from trajopt.ocp.results.extremal import Extremal


@dataclasses.dataclass(frozen=True)
class Obstacle:
    """Why a curve ends before its goal.

    Attributes:
        value: of the parameter: the nearest to the curve that failed.
        reason: in words.
        attempt: the solution that failed; None where the problem's own bounds contradict each
            other.
    """

    value: float
    reason: str
    attempt: Extremal | None

    def __str__(self) -> str:
        """A line for a report."""
        return f"at {self.value:.9g}: {self.reason}"


@dataclasses.dataclass(frozen=True, repr=False)
class Curve:
    """Solutions along a parameter.

    Attributes:
        goal: the last value asked for.
        values: of the parameter, in order; among them are all values asked for that were reached.
        solutions: one for each value. IPOPT succeeded for all of them; only
            `Extremal.converged` tells whether the mesh is fine enough.
        obstacle: why the goal was not reached; None if it was, or if Ctrl-C was pressed.
    """

    goal: float
    values: tuple[float, ...] = ()
    solutions: tuple[Extremal, ...] = ()
    obstacle: Obstacle | None = None

    @property
    def reached(self) -> bool:
        """Whether the goal was reached."""
        return bool(self.values) and self.values[-1] == self.goal

    @property
    def costs(self) -> tuple[float, ...]:
        """The solutions' costs."""
        return tuple(solution.cost for solution in self.solutions)

    def __repr__(self) -> str:
        ends = f"from {self.values[0]:.6g} to {self.values[-1]:.6g}" if self.values else "empty"
        stopped = f", stopped {self.obstacle}" if self.obstacle else ""
        return f"Curve({len(self.values)} solutions, {ends}{stopped})"

    def report(self) -> str:
        """Value and cost of every solution, and the obstacle, as text; failures in capitals."""
        lines = [f"Continuation, {len(self.values)} solution(s), goal {self.goal:.9g}"]
        for value, solution in zip(self.values, self.solutions, strict=True):
            doubts = "" if solution.converged else "; FAILED: " + "; ".join(solution.failures)
            lines.append(f"  {value:<15.9g} cost {solution.cost:.9g}{doubts}")
        if self.obstacle:
            lines.append(f"  STOPPED {self.obstacle}")
        return "\n".join(lines)
