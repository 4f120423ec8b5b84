"""What is to be optimised: phases of smooth motion, linkages between them, and their cost.

    minimise    endpoint_cost + sum over phases of
                    integral of  cost(x, u, p) + sum of max(power_k(x, u, p), floor_k)
    subject to  x' = flow(x, u, p),   path, integral, start and end constraints of each phase,
                x(start of target) = map(x(end of source), p) + offset   for every linkage,
                bounds on states, controls, durations and the static parameters p

Expressions are plain Python functions of CasADi symbols. They are traced once, when the problem is
made; after that a problem can be pickled. How it is discretised is the business of
`trajopt.ocp.transcribe`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.bounds import (
    Bounds,
    InfeasibleBoundsError,
    pair,
    pair_in,
    require_bounds,
    require_room,
)
from trajopt.ocp.pose.constraint import Constraint, Expression, require_constraint
from trajopt.ocp.pose.linkage import Linkage
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.pose.tracing import require_rows, require_scalar, trace

#: Sums of bounds on durations that differ by less (relative) are equal.
ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True)
class Problem:
    """Phases and what joins them.

    Attributes:
        phases: in any order; time runs within each.
        linkages: between their ends.
        parameters: bounds on the static parameters p, by name; a number holds one fixed.
        duration: bounds on the sum of the phases' durations (s), or that sum.
        boundary: constraint on (starts, ends, durations, p): sequences, one entry per phase.
        endpoint_cost: (starts, ends, durations, p) -> scalar.
    """

    phases: tuple[Phase, ...]
    linkages: tuple[Linkage, ...] = ()
    parameters: Bounds = dataclasses.field(default_factory=dict)
    duration: float | tuple[float, float] = (0.0, math.inf)
    boundary: Constraint | None = None
    endpoint_cost: Expression | None = None

    def __post_init__(self) -> None:
        """Check types and bounds, and trace all expressions."""
        self._set("phases", _all_of("phases", self.phases, Phase))
        self._set("linkages", _all_of("linkages", self.linkages, Linkage))
        if not self.phases:
            raise ValueError("phases: a problem has at least one")
        require_bounds("parameters: bounds", self.parameters)
        require_constraint("boundary", self.boundary)
        require_room("duration", *pair_in("duration", self.duration))
        n = len(self.parameters)
        self._set("phases", _traced(self.phases, n))
        self._set("linkages", tuple(link.traced(self.phases, n) for link in self.linkages))
        self._trace_boundary()
        self._require_time()

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _trace_boundary(self) -> None:
        if self.boundary is not None and not isinstance(self.boundary.function, ca.Function):
            traced = self._traced_at_ends("boundary", self.boundary.function)
            require_rows("boundary", traced, self.boundary.names)
            self._set("boundary", dataclasses.replace(self.boundary, function=traced))
        if self.endpoint_cost is not None and not isinstance(self.endpoint_cost, ca.Function):
            traced = self._traced_at_ends("endpoint_cost", self.endpoint_cost)
            require_scalar("endpoint_cost", traced)
            self._set("endpoint_cost", traced)

    def _traced_at_ends(self, name: str, function: Expression) -> ca.Function:
        """A function of (starts, ends, durations, p), traced."""
        if not callable(function):
            raise TypeError(f"{name} = {function!r}: must be a function")
        sizes = [len(phase.states) for phase in self.phases]
        cuts = np.cumsum([0, *sizes]).tolist()

        def split(starts: Any, ends: Any, durations: Any, p: Any) -> Any:
            both = (ca.vertsplit(x, cuts) for x in (starts, ends))
            return function(*both, ca.vertsplit(durations), p)

        return trace(name, split, sum(sizes), sum(sizes), len(sizes), len(self.parameters))

    def _require_time(self) -> None:
        low, high = pair(self.duration)
        least = sum(pair(p.duration)[0] for p in self.phases)
        most = sum(pair(p.duration)[1] for p in self.phases)
        if least > (1 + ROUNDING) * high or most < (1 - ROUNDING) * low:
            raise InfeasibleBoundsError(
                f"duration = {self.duration} s, but the phases' own bounds add up to "
                f"{least:g} to {most:g} s: widen one of them"
            )

    def offset(self, link: Linkage) -> Array:
        """The linkage's offset as a vector (nx,)."""
        return link.offset_of(self.phases[link.target].states)

    @property
    def functions(self) -> tuple[Any, ...]:
        """Everything but numbers: problems that share these differ in their bounds alone."""
        per_phase = [
            (p.flow, p.cost, p.powers, *(c and c.function for c in p.constraints))
            for p in self.phases
        ]
        resets = [(k.source, k.target, k.map) for k in self.linkages]
        boundary = self.boundary and self.boundary.function
        return (*per_phase, *resets, boundary, self.endpoint_cost, tuple(self.parameters))


def _traced(phases: Sequence[Phase], parameters: int) -> tuple[Phase, ...]:
    """The phases, traced; a phase that occurs several times is traced once."""
    traced: dict[int, Phase] = {}
    for phase in phases:
        if id(phase) not in traced:
            traced[id(phase)] = phase.traced(parameters)
    return tuple(traced[id(phase)] for phase in phases)


def _all_of(where: str, items: Any, kind: type) -> tuple[Any, ...]:
    """Items of one type as a tuple."""
    if not isinstance(items, Sequence) or not all(isinstance(item, kind) for item in items):
        raise TypeError(
            f"{where} = {items!r}: must be a tuple of {kind.__name__}s; a tuple of one ends with "
            "a comma"
        )
    return tuple(items)
