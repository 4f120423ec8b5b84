"""One problem of the thesis: how it is posed, what the thesis prints of it, how to search it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeAlias

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import Design
from trajopt.ocp.arrays import Array
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.multi_start import StartFamily
from trajopt.ocp.problem import Problem


@dataclasses.dataclass(frozen=True)
class Printed:
    """What the thesis prints of a case.

    Attributes:
        variant: name of the case.
        cost: its cost; None if not printed, as the others below.
        energy: its energy (J).
        late: error of the last touchdown's time in the thesis's verification (s).
    """

    variant: str
    cost: float | None = None
    energy: float | None = None
    late: float | None = None


@dataclasses.dataclass(frozen=True)
class Effort:
    """How a case is searched.

    Attributes:
        starts: number of random starts.
        elements: of the search's mesh, per step.
        durations: bounds on the durations of the steps of a start (s), log-uniform.
        tolerance: of the refined mesh's error. It is a hundredth of what is asked for, where that
            can be reached, because errors of a falling wheel grow exponentially.
    """

    starts: int = 40
    elements: int = 14
    durations: tuple[float, float] = (0.2, 4.0)
    tolerance: float = 1e-9


USUAL = Effort()

#: Number of the experiment, and name of the variant.
Key: TypeAlias = tuple[int, str]


@dataclasses.dataclass(frozen=True)
class Case:
    """One problem to solve.

    Attributes:
        experiment: its number.
        printed: what the thesis prints of it; two entries if it prints one problem twice.
        params: the machine.
        problem: solution that this case continues, or None -> problem.
        after: the case that this one continues, if any.
        appended: whether the motion is a further step of that case's, simulated together with it.
        effort: of the search.
        quickest: whether the quickest of equally good solutions is kept, not the first.
        limit: whether the case only shows what is possible. Its solution grazes the guards, where
            a simulation cannot follow it well, so that `Solved.converged` does not ask for one.
        design: what is to be chosen of the machine, if anything.
        family: problem -> family of starts; random waypoints by default.
    """

    experiment: int
    printed: tuple[Printed, ...]
    params: WheelParams
    problem: Callable[[Extremal | None], Problem]
    after: Case | None = None
    appended: bool = False
    effort: Effort = USUAL
    quickest: bool = False
    limit: bool = False
    design: Design | None = None
    family: Callable[[Problem], StartFamily] | None = None

    @property
    def variant(self) -> str:
        """Its name."""
        return self.printed[0].variant

    @property
    def key(self) -> Key:
        """What identifies the case."""
        return self.experiment, self.variant

    def machine(self, parameters: Array) -> WheelParams:
        """The machine with these values of what is to be chosen."""
        return self.design.machine(self.params, parameters) if self.design else self.params
