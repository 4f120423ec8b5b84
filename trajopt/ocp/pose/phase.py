"""A phase: a stretch of smooth motion, its bounds, constraints and running cost."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.checks import real
from trajopt.ocp.pose.bounds import (
    Bounds,
    InfeasibleBoundsError,
    names_in,
    pair,
    pair_in,
    require_bounds,
)
from trajopt.ocp.pose.constraint import Constraint, Expression, require_constraint
from trajopt.ocp.pose.tracing import require_rows, require_scalar, trace

#: How far bounds at an end may lie outside those all along. Guards are imposed with such a margin.
MARGIN = 1e-3


@dataclasses.dataclass(frozen=True)
class Phase:
    """A stretch of smooth motion x' = flow(x, u, p) of free or fixed duration.

    Attributes:
        name: for messages.
        states: names of the nx states.
        flow: (x, u, p) -> x'.
        controls: names of the nu controls; none for a passive phase.
        cost: (x, u, p) -> running cost.
        powers: (x, u, p) -> k powers; max(power, floor) of each is paid. The maximum is exact, by
            slack variables, not smoothed.
        floor: the least that is paid for each power; minus infinity pays the powers as they are.
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
    duration: float | tuple[float, float] = (1e-3, math.inf)

    def __post_init__(self) -> None:
        """Check names, types and bounds."""
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
        for table, known in (("bounds", names), ("start", self.states), ("end", self.states)):
            require_bounds(f"{where}: {table}", getattr(self, table), known)
        for name in ("path", "integral", "at_start", "at_end"):
            require_constraint(f"{where}: {name}", getattr(self, name))
        if not (isinstance(self.floor, float) and self.floor == -math.inf):
            real(f"{where}: floor", self.floor)
        self._require_ends_within(where)
        low, high = pair_in(f"{where}: duration", self.duration)
        if not 0.0 < low <= high or math.isinf(low):
            raise InfeasibleBoundsError(
                f"{where}: duration = {self.duration} s: must be positive, lower bound first"
            )

    def _require_ends_within(self, where: str) -> None:
        along = self.state_bounds()
        for end in ("start", "end"):
            lower, upper = self.state_bounds(end)
            gap = np.maximum(lower - along[1], along[0] - upper)
            for name, outside in zip(self.states, gap, strict=True):
                if outside > MARGIN:
                    raise InfeasibleBoundsError(
                        f"{where}: {name} is {getattr(self, end)[name]} at the {end}, but bounded "
                        f"by {self.bounds[name]} all along: widen one of them"
                    )

    def state_bounds(self, where: str = "all along") -> tuple[Array, Array]:
        """(lower, upper) on the states at the "start", the "end" or "all along", each (nx,)."""
        own = {"start": self.start, "end": self.end}.get(where, {})
        return _table({**self.bounds, **own}, self.states)

    def control_bounds(self) -> tuple[Array, Array]:
        """(lower, upper) on the controls, each (nu,)."""
        return _table(self.bounds, self.controls)

    @property
    def constraints(self) -> tuple[Constraint | None, ...]:
        """All that it may have: path, integral, start and end."""
        return self.path, self.integral, self.at_start, self.at_end

    def traced(self, parameters: int) -> Phase:
        """This phase with every expression traced, for so many static parameters.

        Raises:
            TypeError: an expression is not a function.
            ValueError: an expression cannot be traced, or gives the wrong number of numbers.
        """
        nx, nu = len(self.states), len(self.controls)
        along, at_end = (nx, nu, parameters), (nx, parameters)
        where, changes = f"phase {self.name!r}", dict[str, Any]()
        for name in ("flow", "cost", "powers"):
            if name == "flow" or getattr(self, name) is not None:
                changes[name] = trace(f"{where}: {name}", getattr(self, name), *along)
        rates = changes["flow"].size1_out(0)
        if rates != nx:
            raise ValueError(f"{where}: flow gives {rates} rates for the {nx} states {self.states}")
        if "powers" in changes and not changes["powers"].size1_out(0):
            raise ValueError(f"{where}: powers gives no numbers: leave it out")
        if "cost" in changes:
            require_scalar(f"{where}: cost", changes["cost"])
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
