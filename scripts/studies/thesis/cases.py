"""One problem of the thesis: how it is posed, what the thesis prints of it, how to search it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import product
from math import pi
from typing import Any, TypeAlias

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.presets import THESIS_NOMINAL, THESIS_PHYSICAL
from rimless_gym.symbolic import Design, HybridModel
from scripts.studies.thesis.problems import (
    COST_4_3,
    COST_4_4,
    COST_4_5,
    COST_4_6,
    COST_4_7,
    COST_4_8,
    COST_4_9,
    COST_4_12,
    PENDULUM_MASS,
    TABLE_4_3,
    TABLE_4_4,
    TABLE_4_5,
    TABLE_4_7,
    CostWeights,
    Table,
    from_state,
    least_final_swing,
    least_pull,
    steps,
    symmetric,
    towards,
)
from trajopt.ocp.arrays import Array
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.problem import Problem


@dataclasses.dataclass(frozen=True)
class Printed:
    """What the thesis prints of a case."""

    variant: str  # name of the case
    cost: float | None = None  # its cost; None if not printed, as the others below
    energy: float | None = None  # its energy (J)


@dataclasses.dataclass(frozen=True)
class Effort:
    """How a case is searched."""

    starts: int = 40  # number of random starts
    elements: int = 14  # of the search's mesh, per step
    # bounds on the durations of the steps of a start (s), log-uniform
    durations: tuple[float, float] = (0.2, 4.0)
    # of the refined mesh's error. It is a hundredth of what is asked for, where that can be
    # reached, because errors of a falling wheel grow exponentially.
    tolerance: float = 1e-9


USUAL = Effort()

#: Number of the experiment, and name of the variant.
Key: TypeAlias = tuple[int, str]

#: Solution of the case that this one continues, or None -> problem.
Sequel: TypeAlias = Callable[[Extremal | None], Problem]


@dataclasses.dataclass(frozen=True)
class Case:
    """One problem to solve."""

    experiment: int  # its number
    # what the thesis prints of it; two entries if it prints one problem twice
    printed: tuple[Printed, ...]
    params: WheelParams  # the machine
    problem: Sequel
    after: Case | None = None  # the case that this one continues, if any
    # whether the motion is a further step of that case's, simulated together with it
    appended: bool = False
    effort: Effort = USUAL  # of the search
    # whether the case only shows what is possible. Its solution grazes the guards, where a
    # simulation cannot follow it well, so that `SolvedCase.converged` does not ask for one.
    limit: bool = False
    design: Design | None = None  # what is to be chosen of the machine, if anything

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


NOMINAL = THESIS_NOMINAL.replace(motor_mount="frame", impact_law="relabel")
PHYSICAL = THESIS_PHYSICAL.replace(motor_mount="frame", voltage_limit=65.0)

#: Bounds on m2 where it is chosen (kg): the thesis does not print its own.
MASS = (0.5, 2.0)


@cache
def experiment_1() -> tuple[Case, ...]:
    """One step that ends in a collision, Table 4.3.

    A passive fall costs no voltage, however long the wheel balances before it: with cost 4.3, only
    quick ones are admitted, which a simulation can follow.
    """
    short, quick = Effort(20, elements=10), dataclasses.replace(TABLE_4_3, duration=(0.1, 1.0))
    volts, mixed = Printed("cost 4.3", 738.542814), Printed("cost 4.4", 0.040904, 0.001559)
    return (
        _case(1, [volts], (NOMINAL, quick, COST_4_3, 1), short),
        _case(1, [mixed], (NOMINAL, TABLE_4_3, COST_4_4, 1), short),
    )


@cache
def experiment_2() -> tuple[Case, ...]:
    """One step that ends without a collision, Table 4.4, and the least that such a step needs.

    The printed bound of 3 pi on the last theta' admits no such step.
    """
    table = dataclasses.replace(TABLE_4_4, swing=symmetric(8 * pi, 8 * pi, 8 * pi))
    quick = Effort(30, elements=10, durations=(0.15, 1.5))
    printed = Printed("|theta'| <= 8 pi at the end", 1.246894, 139.855118)
    slow, light = Printed("least |theta'| at the end"), Printed("least pull of the foot")
    swing = partial(least_final_swing, NOMINAL, table)
    pull = partial(least_pull, NOMINAL, table)
    much = Effort(60, elements=10, durations=(0.3, 1.2))
    return (
        _case(2, [printed], (NOMINAL, table, COST_4_5, 1), quick),
        Case(2, (slow,), NOMINAL, lambda _: swing(), effort=much, limit=True),
        Case(2, (light,), NOMINAL, lambda _: pull(), effort=quick, limit=True),
    )


@cache
def experiment_3() -> tuple[Case, ...]:
    """Two steps with "perfectly elastic" touchdowns, Table 4.5, m2 given or chosen."""
    costs = {
        "cost 4.6": (COST_4_6, 1344.993117, 61.615496),
        "cost 4.7": (COST_4_7, 855.575987, 43.886971),
        "cost 4.8": (COST_4_8, 1223.694360, 11.050817),
        "cost 4.9": (COST_4_9, 1933.139004, 17.157731),
    }
    masses = {"m2 = 1 kg": None, "m2 free": MASS}
    cases = []
    for (cost, (weights, *numbers)), (name, mass) in product(costs.items(), masses.items()):
        printed = [Printed(f"{cost}, {name}", *numbers)]
        if weights is COST_4_9:  # (4.10) has the same weights
            printed.append(Printed(f"cost 4.10, {name}", 903.897130, 48.547980))
        posed = (NOMINAL, TABLE_4_5, weights, 2)
        cases.append(_case(3, printed, posed, Effort(20), mass=mass))
    wider = [Printed("cost 4.6, m2 free from 0.1 kg")]
    posed = (NOMINAL, TABLE_4_5, COST_4_6, 2)
    cases.append(_case(3, wider, posed, Effort(10), mass=(0.1, MASS[1])))
    return tuple(cases)


@cache
def experiment_4() -> tuple[Case, ...]:
    """Three elastic steps."""
    printed = [Printed("cost 4.6, m2 = 1 kg", 2366.986710, 19.687079)]
    return (_case(4, printed, (NOMINAL, TABLE_4_5, COST_4_6, 3), Effort(20)),)


@cache
def experiment_5() -> tuple[Case, ...]:
    """Two steps with collisions, Table 4.7: both impact laws, both printed bounds on phi'(0)."""
    cases = []
    for law, limit in product(("plastic", "thesis"), (10.0, 2.5)):
        params = PHYSICAL.replace(impact_law=law)
        table = dataclasses.replace(TABLE_4_7, rate=((0.5, limit), *TABLE_4_7.rate[1:]))
        name = f"{law}, phi'(0) <= {limit:g}"
        posed = (params, table, COST_4_12, 2)
        short = (0.15, 1.2)
        printed = [Printed(name, 1999.992695, 74.206063)]
        starts = 40 if limit == 10.0 else 80  # many optima have phi'(0) at its bound
        cases.append(_case(5, printed, posed, Effort(starts, durations=short)))
        if law == "plastic":
            unpinned = [Printed(f"{name}, foot not held down")]
            effort = Effort(30, durations=short, tolerance=1e-8)
            cases.append(_case(5, unpinned, posed, effort, contact=True))
    return tuple(cases)


@cache
def experiment_6() -> tuple[Case, ...]:
    """Single steps, each from where the one before ended: elastic, and plastic towards 5's end."""
    elastic = Case(
        experiment=6,
        printed=(Printed("elastic, step 2", 0.040907, 0.003125),),
        params=NOMINAL,
        problem=_continued(NOMINAL, TABLE_4_3, COST_4_4),
        after=experiment_1()[1],
        appended=True,
        effort=Effort(20, elements=10),
    )
    plastic = PHYSICAL.replace(impact_law="plastic")
    two_steps = next(case for case in experiment_5() if case.variant.startswith("plastic"))
    first = Case(
        experiment=6,
        printed=(Printed("plastic, step 1", 992.569180),),
        params=plastic,
        problem=_aimed(plastic, TABLE_4_7, COST_4_12),
        after=two_steps,
    )
    second = Case(
        experiment=6,
        printed=(Printed("plastic, step 2", 4.741788, 57.619640),),
        params=plastic,
        problem=_continued(plastic, TABLE_4_7, COST_4_12),
        after=first,
        appended=True,
    )
    return elastic, first, second


_ALL = experiment_1, experiment_2, experiment_3, experiment_4, experiment_5, experiment_6
EXPERIMENTS = dict(enumerate(_ALL, 1))


def every_case() -> list[Case]:
    """The cases of all experiments, in order."""
    return [case for experiment in EXPERIMENTS.values() for case in experiment()]


def needed(numbers: Sequence[int]) -> list[Case]:
    """The cases of some experiments and the cases that they continue, in order."""
    keys = set()
    for case in reversed(every_case()):  # what a case continues comes before it
        if case.experiment in numbers or case.key in keys:
            keys |= {case.key} | ({case.after.key} if case.after else set())
    return [case for case in every_case() if case.key in keys]


def case_of(key: Key) -> Case:
    """The case with this key."""
    return next(case for case in every_case() if case.key == key)


def _case(
    experiment: int,
    printed: Sequence[Printed],
    posed: tuple[WheelParams, Table, CostWeights, int],
    effort: Effort = USUAL,
    **options: Any,
) -> Case:
    """Steps posed by (machine, bounds, cost, count) and further arguments of `steps`."""
    problem = partial(steps, *posed, **options)
    return Case(
        *(experiment, tuple(printed), posed[0], lambda _: problem()),
        effort=effort,
        design=PENDULUM_MASS if options.get("mass") else None,
    )


def _continued(params: WheelParams, table: Table, weights: CostWeights) -> Sequel:
    """A single step from where, by the impact law, the one before leads."""
    touchdown = HybridModel(params).functions["touchdown"]

    def problem(before: Extremal | None) -> Problem:
        assert before is not None
        start = np.asarray(touchdown(before.phases[-1].end)).ravel()
        return from_state(steps(params, table, weights), start)

    return problem


def _aimed(params: WheelParams, table: Table, weights: CostWeights) -> Sequel:
    """A single step that ends where and when the first one of a solution does."""

    def problem(target: Extremal | None) -> Problem:
        assert target is not None
        first = target.phases[0]
        return towards(steps(params, table, weights), first.end, first.duration)

    return problem
