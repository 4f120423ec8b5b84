"""What is to be optimised: phases of smooth motion, linkages between them, and their cost.

    minimise    endpoint_cost + sum over phases of
                    integral of  cost(x, u, p) + sum of max(power_k(x, u, p), floor_k)
    subject to  x' = flow(x, u, p),   path, integral, start and end constraints of each phase,
                x(start of target) = map(x(end of source), p) + offset   for every linkage,
                bounds on states, controls, durations and the static parameters p

Expressions are plain Python functions of CasADi symbols. They are traced once, when the problem is
made; after that a problem can be pickled.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.checks import real
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import (
    Bounds,
    Constraint,
    Expression,
    InfeasibleBoundsError,
    names_in,
    pair,
    require_bounds,
    require_room,
    require_rows,
    trace,
)

#: Sums of bounds on durations that differ by less (relative) are equal.
ROUNDING = 1e-12

#: How far bounds at an end may lie outside those all along, relative to the largest bound of that
#: state, or by rounding in absolute terms. Guards are imposed with such a margin.
MARGIN, OUTSIDE = 1e-3, 1e-15


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
        require_bounds("parameters: bounds", self.parameters)
        require_room("duration", *pair(self.duration, "duration"))
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
            require_rows("endpoint_cost", traced, ("cost",))
            self._set("endpoint_cost", traced)

    def _traced_at_ends(self, name: str, function: Expression) -> ca.Function:
        """A function of (starts, ends, durations, p), traced."""
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
        states = self.phases[link.target].states
        return np.array([link.offset.get(name, 0.0) for name in states])

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


@dataclasses.dataclass(frozen=True)
class Phase:
    """A stretch of smooth motion x' = flow(x, u, p) of free or fixed duration.

    Attributes:
        name: for messages.
        states: names of the nx states.
        flow: (x, u, p) -> x'.
        controls: names of the nu controls; none for a passive phase.
        cost: (x, u, p) -> running cost.
        powers: (x, u, p) -> k powers; max(power, floor) of each adds to the running cost. The
            maximum is exact, by slack variables, not smoothed.
        floor: of each power; minus infinity adds the powers as they are.
        path: constraint on (x, u, p) all along.
        integral: constraint on the integrals of expressions in (x, u, p) over the phase.
        at_start: constraint on (x, p) at the start.
        at_end: constraint on (x, p) at the end.
        bounds: on states and controls, by name, all along.
        start: bounds on states at the start, in place of those all along.
        end: bounds on states at the end, in place of those all along.
        duration: bounds (s), or the duration.
    """

    name: str
    states: tuple[str, ...]
    flow: Expression
    controls: tuple[str, ...] = ()
    cost: Expression | None = None
    powers: Expression | None = None
    floor: float = 0.0
    path: Constraint | None = None
    integral: Constraint | None = None
    at_start: Constraint | None = None
    at_end: Constraint | None = None
    bounds: Bounds = dataclasses.field(default_factory=dict)
    start: Bounds = dataclasses.field(default_factory=dict)
    end: Bounds = dataclasses.field(default_factory=dict)
    duration: float | tuple[float, float] = (0.0, math.inf)

    def __post_init__(self) -> None:
        where = f"phase {self.name!r}"
        for kind in ("states", "controls"):
            object.__setattr__(self, kind, names_in(f"{where}: {kind}", getattr(self, kind)))
        names = self.states + self.controls
        if not self.states or len(set(names)) < len(names):
            raise ValueError(
                f"{where}: states {self.states} and controls {self.controls}: name at "
                "least one state, and everything differently"
            )
        for table, known in (("bounds", names), ("start", self.states), ("end", self.states)):
            require_bounds(f"{where}: {table}", getattr(self, table), known)
        self._require_ends_within(where)
        low, high = pair(self.duration, f"{where}: duration")
        if not 0.0 <= low <= high or high == 0.0 or math.isinf(low):
            raise InfeasibleBoundsError(
                f"{where}: duration = {self.duration} s: must be positive, lower bound first"
            )

    def _require_ends_within(self, where: str) -> None:
        along, ends = self.state_bounds(), {e: self.state_bounds(e) for e in ("start", "end")}
        sizes = np.abs([*along, *ends["start"], *ends["end"]])
        room = MARGIN * np.where(np.isfinite(sizes), sizes, 0.0).max(axis=0) + OUTSIDE
        for end, (lower, upper) in ends.items():
            gap = np.maximum(lower - along[1], along[0] - upper)
            for name, outside, most in zip(self.states, gap, room, strict=True):
                if outside > most:
                    raise InfeasibleBoundsError(
                        f"{where}: {name} is {getattr(self, end)[name]} at the {end}, but bounded "
                        f"by {self.bounds[name]} all along: widen one of them"
                    )

    def state_bounds(self, where: str = "all along") -> tuple[Array, Array]:
        """(lower, upper) on the states at the "start", the "end" or "all along", each (nx,)."""
        replaced = {"start": self.start, "end": self.end}.get(where, {})
        return _table({**self.bounds, **replaced}, self.states)

    def control_bounds(self) -> tuple[Array, Array]:
        """(lower, upper) on the controls, each (nu,)."""
        return _table(self.bounds, self.controls)

    @property
    def constraints(self) -> tuple[Constraint | None, ...]:
        """All that it may have: path, integral, start and end."""
        return self.path, self.integral, self.at_start, self.at_end

    def traced(self, parameters: int) -> Phase:
        """This phase with every expression traced, for so many static parameters; see `trace`."""
        nx, nu = len(self.states), len(self.controls)
        along, at_end = (nx, nu, parameters), (nx, parameters)
        where, changes = f"phase {self.name!r}", dict[str, Any]()
        for name in ("flow", "cost", "powers"):
            if name == "flow" or getattr(self, name) is not None:
                changes[name] = trace(f"{where}: {name}", getattr(self, name), *along)
        require_rows(f"{where}: flow", changes["flow"], self.states)
        if "cost" in changes:
            require_rows(f"{where}: cost", changes["cost"], ("cost",))
        sizes = {"path": along, "integral": along, "at_start": at_end, "at_end": at_end}
        for name, arguments in sizes.items():
            constraint = getattr(self, name)
            if constraint is not None:
                function = trace(f"{where}: {name}", constraint.function, *arguments)
                require_rows(f"{where}: {name}", function, constraint.names)
                changes[name] = dataclasses.replace(constraint, function=function)
        return dataclasses.replace(self, **changes)


def _table(bounds: Bounds, names: Sequence[str]) -> tuple[Array, Array]:
    pairs = [pair(bounds.get(name, (-math.inf, math.inf))) for name in names]
    lower, upper = np.array(pairs, dtype=float).reshape(-1, 2).T
    return lower, upper


@dataclasses.dataclass(frozen=True)
class Linkage:
    """x at the start of phase `target` = map(x at the end of phase `source`, p) + offset.

    Attributes:
        source: index of a phase.
        target: index of a phase; an earlier or the same one closes a cycle.
        map: (x, p) -> x, any reset map; the identity by default.
        offset: constant shift by state, such as whole turns of an angle; none by default.
    """

    source: int
    target: int
    map: Expression = lambda x, p: x
    offset: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in self.offset.items():
            real(f"linkage: offset of {name}", value)

    def traced(self, phases: Sequence[Phase], parameters: int) -> Linkage:
        """This linkage with its map traced, for these phases and so many static parameters."""
        for side, index in (("source", self.source), ("target", self.target)):
            if not 0 <= index < len(phases):
                raise ValueError(
                    f"linkage: {side} = {index}: there are {len(phases)} phases, from 0"
                )
        source, target = phases[self.source], phases[self.target]
        unknown = [name for name in self.offset if name not in target.states]
        if unknown:
            raise ValueError(f"linkage: offset names {unknown}, not among {target.states}")
        where = f"linkage from {source.name!r} to {target.name!r}: map"
        reset = trace(where, self.map, len(source.states), parameters)
        require_rows(where, reset, target.states)
        return dataclasses.replace(self, map=reset)
