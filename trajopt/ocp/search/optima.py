"""Starts of a search, how each of them ended, and which ended at the same local optimum."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TypeAlias

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.solving.guesses import Guess
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: By how much costs (relative) and states along the phases (relative to 1 + their magnitude) of one
#: optimum may differ.
SAME_COST, SAME_STATES = 1e-4, 1e-2


@dataclasses.dataclass(frozen=True)
class Start:
    """A guess, and how to solve from it.

    Attributes:
        guess: one trajectory per phase.
        parameters: guess of the static parameters; the middle of their bounds by default.
        problems: what is solved, each from the solution of the one before; by default the search's
            problem. They differ from it in numbers alone, and must be made from the copy that the
            family holds: then they share its functions in another process too.
        kind: of optimum ("2 turns"); optima of different kinds are different.
    """

    guess: Guess
    parameters: Array | None = None
    problems: tuple[Problem, ...] = ()
    kind: str = ""


#: (generator, index) -> where start number `index` begins. Every start has a generator of its own.
StartFamily: TypeAlias = Callable[[np.random.Generator, int], Guess | Start]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How one start ended.

    Attributes:
        index: of the start.
        kind: see `Start`.
        cost: the objective of the nonlinear program.
        phases: the last trajectory.
        parameters: the static parameters.
        iterations: of IPOPT, for all of the start's problems.
        failure: in words; empty if it is a local optimum.
    """

    index: int
    kind: str
    cost: float
    phases: tuple[PhaseTrajectory, ...]
    parameters: Array
    iterations: int
    failure: str

    @cached_property
    def _samples(self) -> list[Array]:
        fractions = np.linspace(0.0, 1.0, 33)
        return [phase.state(phase.duration * fractions) for phase in self.phases]

    def same_as(self, other: Outcome) -> bool:
        """Whether both are the same optimum, as far as a coarse mesh can tell."""
        if self.kind != other.kind:
            return False
        if not math.isclose(self.cost, other.cost, rel_tol=SAME_COST, abs_tol=1e-9):
            return False
        mine, theirs = ([p.duration for p in o.phases] for o in (self, other))
        pairs = zip(self._samples, other._samples, strict=True)
        return np.allclose(mine, theirs, rtol=SAME_STATES) and all(_alike(a, b) for a, b in pairs)


def _alike(a: Array, b: Array) -> bool:
    return bool(np.all(np.abs(a - b) <= SAME_STATES * (1.0 + np.abs(a).max(axis=0))))


@dataclasses.dataclass(frozen=True)
class Optimum:
    """A local optimum, and the starts that led to it.

    Attributes:
        best: the outcome of least cost; the first of those that tie.
        found: indices of all these starts, ascending.
    """

    best: Outcome
    found: tuple[int, ...]

    @property
    def cost(self) -> float:
        """On the search's mesh."""
        return self.best.cost

    @property
    def phases(self) -> tuple[PhaseTrajectory, ...]:
        """The trajectory, on the search's mesh."""
        return self.best.phases


#: Whether two outcomes are one optimum.
Same: TypeAlias = Callable[[Outcome, Outcome], bool]


def distinct(outcomes: Iterable[Outcome], same: Same = Outcome.same_as) -> tuple[Optimum, ...]:
    """The different optima among the outcomes that are no failures, best first."""
    successes = [outcome for outcome in outcomes if not outcome.failure]
    groups: list[list[Outcome]] = []
    in_turn = sorted(successes, key=lambda o: o.index)
    for outcome in least_first(in_turn, lambda o: o.cost):
        group = next((g for g in groups if same(g[0], outcome)), None)
        if group is None:
            groups.append([outcome])
        else:
            group.append(outcome)
    return tuple(Optimum(g[0], tuple(sorted(o.index for o in g))) for g in groups)
