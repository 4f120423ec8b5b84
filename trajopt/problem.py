"""What is to be optimised: phases of continuous motion, linkages between them, and their cost.

Nothing here knows how a problem is discretised (`trajopt.radau`) or what walks
(`trajopt.walking`).
"""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Constraint:
    """``lower <= function(...) <= upper``, elementwise.

    Attributes:
        function: a `casadi.Function` of one vector output with m rows.
        lower: bounds, shape (m,).
        upper: bounds, shape (m,).
        names: what each row means, for messages; m of them.
    """

    function: ca.Function
    lower: Array
    upper: Array
    names: tuple[str, ...]

    def violation(self, values: Array) -> Array:
        """How far `values` (..., m) lie outside the bounds; 0 inside."""
        outside: Array = np.maximum(self.lower - values, values - self.upper)
        return np.maximum(outside, 0.0)


@dataclasses.dataclass(frozen=True)
class Phase:
    """A stretch of smooth motion x' = flow(x, u) of free duration.

    Its cost is the integral of ``max(power(x, u), floor)``; an infinitely low floor leaves the
    integral of the power itself.

    Attributes:
        flow: (x, u) -> x', shapes (nx,), (nu,) -> (nx,).
        power: (x, u) -> integrand of the cost, a scalar.
        path: constraints on (x, u) all along.
        end: constraints on x at the end of the phase.
        state_bounds: (lower, upper) on x all along, each (nx,).
        start_bounds: likewise at the start.
        end_bounds: likewise at the end.
        control_bounds: (lower, upper) on u, each (nu,).
        duration_bounds: (s).
        floor: least value of the integrand that counts.
    """

    flow: ca.Function
    power: ca.Function
    path: Constraint
    end: Constraint
    state_bounds: tuple[Array, Array]
    start_bounds: tuple[Array, Array]
    end_bounds: tuple[Array, Array]
    control_bounds: tuple[Array, Array]
    duration_bounds: tuple[float, float] = (1e-3, math.inf)
    floor: float = 0.0

    @property
    def n_states(self) -> int:
        """nx."""
        return int(self.flow.size1_in(0))


@dataclasses.dataclass(frozen=True)
class Linkage:
    """x at the start of phase `target` = map(x at the end of phase `source`) + offset.

    Attributes:
        source: index of a phase.
        target: index of a phase.
        map: x -> x.
        offset: constant shift, shape (nx,).
    """

    source: int
    target: int
    map: ca.Function
    offset: Array


@dataclasses.dataclass(frozen=True)
class Problem:
    """Phases, the linkages that join them, and their total duration (s), which is given."""

    phases: tuple[Phase, ...]
    linkages: tuple[Linkage, ...]
    duration: float
