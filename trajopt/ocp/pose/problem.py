"""What is to be optimised: phases of smooth motion, linkages between them, and their cost.

    minimise    endpoint_cost + sum over phases of
                    integral of  cost(x, u, p) + sum of max(power_k(x, u, p), floor_k)
    subject to  x' = flow(x, u, p),   path, integral, start and end constraints of each phase,
                x(start of target) = map(x(end of source), p) + offset   for every linkage,
                bounds on states, controls, durations and the static parameters p

Expressions are plain Python functions of CasADi symbols and are traced once, when the problem is
made; a problem can then be pickled. Nothing here knows how a problem is discretised
(`trajopt.ocp.transcribe.schemes`), nor what walks.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import integer, real, real_array
from trajopt.ocp.pose.bounds import (
    Bounds,
    InfeasibleBoundsError,
    names_in,
    pair,
    pair_in,
    require_bounds,
    require_room,
)
from trajopt.ocp.pose.tracing import require_rows, require_scalar, trace, traced_phases

Array = NDArray[np.float64]

#: (x, u, p) -> a scalar, or a vector as a sequence; or the `casadi.Function` of it.
Expression = Callable[..., Any]

#: By how much a phase's ends may lie outside the bounds all along: a guard and a margin to it.
MARGIN = 1e-3


#: Sums of bounds on durations that differ by less (relative) are equal.
ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True)
class Constraint:
    """``lower <= function(...) <= upper``, elementwise.

    Attributes:
        function: m expressions.
        lower: bounds, shape (m,).
        upper: bounds, shape (m,).
        names: what each row means, for messages; m of them.
    """

    function: Expression
    lower: Array
    upper: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check that there is a bound for every name, and room between them."""
        object.__setattr__(self, "names", names_in("constraint: names", self.names, least=1))
        for side in ("lower", "upper"):
            values = real_array(f"constraint {self.names}: {side}", getattr(self, side))
            if values.shape not in ((), (1,), (len(self.names),)):
                raise ValueError(
                    f"constraint {self.names}: {side} = {values}: give one number, or one for each "
                    f"of its {len(self.names)} names"
                )
            values = np.broadcast_to(values.astype(float), (len(self.names),))
            object.__setattr__(self, side, values)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            require_room(name, low, high)

    def violation(self, values: Array) -> Array:
        """How far `values` (..., m) lie outside the bounds; 0 inside."""
        outside: Array = np.maximum(self.lower - values, values - self.upper)
        return np.maximum(outside, 0.0)


def nonnegative(function: Expression, *names: str) -> Constraint:
    """The constraint ``function(...) >= 0``, row by row."""
    return Constraint(function, np.zeros(len(names)), np.full(len(names), np.inf), names)


def equal(function: Expression, values: Sequence[float], *names: str) -> Constraint:
    """The constraint ``function(...) == values``, row by row."""
    return Constraint(function, values, values, names)  # type: ignore[arg-type]


@dataclasses.dataclass(frozen=True)
class Phase:
    """A stretch of smooth motion x' = flow(x, u, p) of free or fixed duration.

    Attributes:
        name: for messages.
        states: names of the nx states.
        flow: (x, u, p) -> x'.
        controls: names of the nu controls; none for a passive phase.
        cost: (x, u, p) -> running cost.
        powers: (x, u, p) -> k powers, of which max(power, floor) is paid; the maximum is exact,
            by slack variables, not smoothed.
        floor: the least that counts of every power; minus infinity pays the powers themselves.
        path: constraint on (x, u, p) all along.
        integral: constraint on the integrals of expressions in (x, u, p) over the phase.
        at_start: constraint on (x, p) at the start.
        at_end: constraint on (x, p) at the end.
        bounds: on states and controls, by name, all along.
        start: on states at the start, in place of those all along.
        end: on states at the end, in place of those all along.
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
    duration: float | tuple[float, float] = (1e-3, math.inf)

    def __post_init__(self) -> None:
        """Check names, kinds and bounds."""
        if not isinstance(self.name, str):
            raise TypeError(f"phase: name = {self.name!r}: must be text")
        where = f"phase {self.name!r}"
        for kind in ("states", "controls"):
            object.__setattr__(self, kind, names_in(f"{where}: {kind}", getattr(self, kind)))
        names = self.states + self.controls
        if not self.states or len(set(names)) < len(names):
            raise ValueError(
                f"{where}: states {self.states} and controls {self.controls}: name at "
                "least one state, and everything differently"
            )
        for table, known in (
            ("bounds", self.states + self.controls),
            ("start", self.states),
            ("end", self.states),
        ):
            require_bounds(f"{where}: {table}", getattr(self, table), known)
        for name in ("path", "integral", "at_start", "at_end"):
            _require_constraint(f"{where}: {name}", getattr(self, name))
        if not (isinstance(self.floor, float) and self.floor == -math.inf):
            real(f"{where}: floor", self.floor)
        along = self.state_bounds()
        for end in ("start", "end"):
            lower, upper = self.state_bounds(end)
            gap = np.maximum(lower - along[1], along[0] - upper)
            for name, outside in zip(self.states, gap, strict=True):
                if outside > MARGIN:
                    raise InfeasibleBoundsError(
                        f"phase {self.name!r}: {name} is {getattr(self, end)[name]} at the "
                        f"{end}, but bounded by {self.bounds[name]} all along: widen one of them"
                    )
        low, high = pair_in(f"{where}: duration", self.duration)
        if not 0.0 < low <= high or math.isinf(low):
            raise InfeasibleBoundsError(
                f"{where}: duration = {self.duration} s: must be positive, lower bound first"
            )

    def state_bounds(self, where: str = "all along") -> tuple[Array, Array]:
        """(lower, upper) on the states at the "start", the "end" or "all along", each (nx,)."""
        own = {"start": self.start, "end": self.end}.get(where, {})
        return _table({**self.bounds, **own}, self.states)

    def control_bounds(self) -> tuple[Array, Array]:
        """(lower, upper) on the controls, each (nu,)."""
        return _table(self.bounds, self.controls)


@dataclasses.dataclass(frozen=True)
class Linkage:
    """x at the start of phase `target` = map(x at the end of phase `source`, p) + offset.

    Attributes:
        source: index of a phase.
        target: index of a phase; an earlier or the same one closes a cycle.
        map: (x, p) -> x, any reset map; the identity by default.
        offset: constant shift, such as whole turns of an angle, by state; none by default.
    """

    source: int
    target: int
    map: Expression = lambda x, p: x
    offset: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check kinds and numbers; whether such phases and states exist is the problem's to say."""
        for side in ("source", "target"):
            integer(f"linkage: {side}", getattr(self, side), 0)
        if not isinstance(self.offset, Mapping):
            raise TypeError(f"linkage: offset = {self.offset!r}: must be a mapping, name: number")
        for name, value in self.offset.items():
            real(f"linkage: offset of {name}", value)


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
        """Check kinds and bounds, and trace all expressions."""
        self._set("phases", _all_of("phases", self.phases, Phase))
        self._set("linkages", _all_of("linkages", self.linkages, Linkage))
        if not self.phases:
            raise ValueError("phases: a problem has at least one")
        require_bounds("parameters: bounds", self.parameters)
        _require_constraint("boundary", self.boundary)
        low, high = pair_in("duration", self.duration)
        require_room("duration", low, high)
        n = len(self.parameters)
        object.__setattr__(self, "phases", tuple(traced_phases(self.phases, n)))
        object.__setattr__(self, "linkages", tuple(self._traced_linkage(k) for k in self.linkages))
        sizes = [len(p.states) for p in self.phases]

        def at_ends(name: str, function: Expression) -> Expression:
            if not callable(function):
                raise TypeError(f"{name} = {function!r}: must be a function")

            def split(starts: Any, ends: Any, durations: Any, p: Any) -> Any:
                cuts = np.cumsum([0, *sizes]).tolist()
                both = (ca.vertsplit(x, cuts) for x in (starts, ends))
                return function(*both, ca.vertsplit(durations), p)

            return split

        dimensions = (sum(sizes), sum(sizes), len(sizes), n)
        if self.boundary is not None and not isinstance(self.boundary.function, ca.Function):
            traced = trace("boundary", at_ends("boundary", self.boundary.function), *dimensions)
            require_rows("boundary", traced, self.boundary.names)
            self._set("boundary", dataclasses.replace(self.boundary, function=traced))
        if self.endpoint_cost is not None and not isinstance(self.endpoint_cost, ca.Function):
            cost = at_ends("endpoint_cost", self.endpoint_cost)
            traced = trace("endpoint_cost", cost, *dimensions)
            require_scalar("endpoint_cost", traced)
            self._set("endpoint_cost", traced)
        least = sum(pair(p.duration)[0] for p in self.phases)
        most = sum(pair(p.duration)[1] for p in self.phases)
        if least > (1 + ROUNDING) * high or most < (1 - ROUNDING) * low:
            raise InfeasibleBoundsError(
                f"duration = {self.duration} s, but the phases' own bounds add up to "
                f"{least:g} to {most:g} s: widen one of them"
            )

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _traced_linkage(self, link: Linkage) -> Linkage:
        for side, index in (("source", link.source), ("target", link.target)):
            if not 0 <= index < len(self.phases):
                raise ValueError(
                    f"linkage: {side} = {index}: there are {len(self.phases)} phases, from 0"
                )
        source, target = self.phases[link.source], self.phases[link.target]
        unknown = [name for name in link.offset if name not in target.states]
        if unknown:
            raise ValueError(f"linkage: offset names {unknown}, not among {target.states}")
        where = f"linkage from {source.name!r} to {target.name!r}: map"
        reset = trace(where, link.map, len(source.states), len(self.parameters))
        if reset.size1_out(0) != len(target.states):
            raise ValueError(
                f"linkage from {source.name!r} to {target.name!r}: its map gives "
                f"{reset.size1_out(0)} numbers for the {len(target.states)} states {target.states}"
            )
        return dataclasses.replace(link, map=reset)

    def offset(self, link: Linkage) -> Array:
        """The linkage's offset as a vector (nx,)."""
        return np.array([link.offset.get(name, 0.0) for name in self.phases[link.target].states])

    @property
    def functions(self) -> tuple[Any, ...]:
        """Everything but numbers: problems that share these differ in their bounds alone."""
        per_phase = [
            (p.flow, p.cost, p.powers, *(c and c.function for c in _constraints(p)))
            for p in self.phases
        ]
        resets = [(k.source, k.target, k.map) for k in self.linkages]
        boundary = self.boundary and self.boundary.function
        return (*per_phase, *resets, boundary, self.endpoint_cost, tuple(self.parameters))


def _constraints(phase: Phase) -> tuple[Constraint | None, ...]:
    return phase.path, phase.integral, phase.at_start, phase.at_end


def _table(bounds: Bounds, names: Sequence[str]) -> tuple[Array, Array]:
    pairs = [pair(bounds.get(name, (-math.inf, math.inf))) for name in names]
    lower, upper = np.array(pairs, dtype=float).reshape(-1, 2).T
    return lower, upper


def _all_of(where: str, items: Any, kind: type) -> tuple[Any, ...]:
    """Items of one kind as a tuple."""
    if not isinstance(items, Sequence) or not all(isinstance(item, kind) for item in items):
        raise TypeError(
            f"{where} = {items!r}: must be a tuple of {kind.__name__}s; that of a single one ends "
            "with a comma"
        )
    return tuple(items)


def _require_constraint(where: str, constraint: Any) -> None:
    if constraint is not None and not isinstance(constraint, Constraint):
        raise TypeError(
            f"{where} = {constraint!r}: must be a Constraint; `equal` and `nonnegative` make some"
        )
