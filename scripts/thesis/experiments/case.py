"""One problem of the thesis: how it is posed, what was printed of it, how hard to look for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeAlias

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import Design
from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.search.optima import StartFamily


@dataclasses.dataclass(frozen=True)
class Printed:
    """What the thesis prints of a case.

    Attributes:
        variant: which one.
        cost: its cost.
        energy: its energy (J).
        late: by how much its last touchdown was off in the thesis's verification (s).
    """

    variant: str
    cost: float | None = None
    energy: float | None = None
    late: float | None = None


@dataclasses.dataclass(frozen=True)
class Effort:
    """How a case is searched.

    Attributes:
        starts: how many.
        elements: per step.
        durations: of the steps to begin with, log-uniform between these (s).
        tolerance: of the refined mesh's error; a hundredth of what is asked for where it can be
            had, since wheels fall over exponentially.
    """

    starts: int = 40
    elements: int = 14
    durations: tuple[float, float] = (0.2, 4.0)
    tolerance: float = 1e-9


USUAL = Effort()

#: Experiment and variant.
Key: TypeAlias = tuple[int, str]


@dataclasses.dataclass(frozen=True)
class Case:
    """One problem to solve.

    Attributes:
        experiment: its number.
        printed: what the thesis prints of it; twice if it prints one problem twice.
        params: the machine.
        problem: of the solution that it continues, if any.
        after: whose solution that is.
        appended: whether it is a further step of that motion, simulated and paid with it.
        effort: of the search.
        quickest: whether of equally good solutions the quickest is kept, not the first.
        limit: whether it only says what is possible: grazing the guards, it is not simulated well.
        design: what is to be chosen of the machine, if anything.
        family: of the starts; random waypoints by default.
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
        """What it is called."""
        return self.printed[0].variant

    @property
    def key(self) -> Key:
        """Of this case alone."""
        return self.experiment, self.variant

    def machine(self, parameters: Array) -> WheelParams:
        """The machine with what was chosen of it."""
        return self.design.machine(self.params, parameters) if self.design else self.params
