"""Bounds and constraints, and the tracing of the functions that a problem is made of."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from rimless_gym.checks import real_array
from trajopt.ocp.arrays import Array

#: A Python function of CasADi symbols, mostly (x, u, p), that returns a scalar or a sequence of
#: scalars; or the `casadi.Function` traced from it.
Expression: TypeAlias = Callable[..., Any]

#: Bounds by name: (lower, upper), or one number where both are equal. Unbounded names are left out.
Bounds = Mapping[str, float | tuple[float, float]]

#: Relative violations below this are rounding.
NOTEWORTHY = 1e-9

#: Arguments with which a traced function is tried: of any size, since its units are not known.
TRIED = (0.3, 0.7, -0.4, 1e-3, 1e-6, 1e-9, 1e3, 1e6)


class InfeasibleBoundsError(ValueError):
    """Bounds contradict each other: there is nothing to solve."""


@dataclasses.dataclass(frozen=True)
class Constraint:
    """``lower <= function(...) <= upper``, elementwise.

    Attributes:
        function: m expressions.
        lower: bounds, shape (m,).
        upper: bounds, shape (m,).
        names: of the m rows, for messages.
    """

    function: Expression
    lower: Array
    upper: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", names_in("constraint: names", self.names))
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
        return np.maximum(beyond(values, self.lower, self.upper), 0.0)


def beyond(values: Array, lower: Array, upper: Array) -> Array:
    """How far values (..., m) are outside bounds (m,); negative inside."""
    return np.asarray(np.maximum(lower - values, values - upper))


@dataclasses.dataclass(frozen=True)
class Violation:
    """A constraint or bound that is violated.

    Attributes:
        kind: of constraint, see `trajopt.ocp.equations.Rows`; "bound" for bounds; the name of a
            function that is not finite.
        name: of the row.
        phase: name of the phase; empty for the problem as a whole.
        time: from the phase's start (s).
        amount: of the violation.
        relative: the amount, relative to the scale of what is violated.
    """

    kind: str
    name: str
    phase: str
    time: float
    amount: float
    relative: float

    def __str__(self) -> str:
        where = f" of phase {self.phase!r} at t = {self.time:.6g} s" if self.phase else ""
        name = f" of {self.name}" if self.name else ""
        if math.isinf(self.amount):
            return f"{self.kind}{name}{where} is not finite"
        return (
            f"{self.kind}{name}{where} violated by {self.amount:.1e} (relative {self.relative:.1e})"
        )


def nonnegative(function: Expression, *names: str) -> Constraint:
    """The constraint ``function(...) >= 0``, row by row."""
    return Constraint(function, np.zeros(len(names)), np.full(len(names), np.inf), names)


def equal(function: Expression, values: Sequence[float], *names: str) -> Constraint:
    """The constraint ``function(...) == values``, row by row."""
    return Constraint(function, values, values, names)  # type: ignore[arg-type]


# -- bounds and names ---------------------------------------------------------------------------


def pair(bounds: float | tuple[float, float], where: str = "bounds") -> tuple[float, float]:
    """Bounds as (lower, upper); one number stands for both, and others are a TypeError."""
    both: Any = bounds if isinstance(bounds, (Sequence, np.ndarray)) else (bounds, bounds)
    try:
        low, high = both
        if not isinstance(low, str) and not isinstance(high, str):
            return float(low), float(high)
    except (TypeError, ValueError, OverflowError):
        pass
    raise TypeError(f"{where} = {bounds!r}: must be a real number, or (lower, upper)")


def require_room(where: str, low: float, high: float) -> None:
    """Refuse bounds that no number satisfies, with an InfeasibleBoundsError."""
    if not low <= high or low == math.inf or high == -math.inf:
        raise InfeasibleBoundsError(
            f"{where}: bounds ({low:g}, {high:g}): no number lies between them; give the lower "
            "bound first"
        )


def require_bounds(where: str, table: Any, known: Sequence[str] | None = None) -> None:
    """Refuse a table with invalid bounds or, where `known` is given, with an unknown name."""
    unknown = [name for name in table if known is not None and name not in known]
    if unknown:
        raise ValueError(f"{where} names {unknown}, which are not among {known}")
    for name, bounds in table.items():
        require_room(f"{where} of {name}", *pair(bounds, f"{where} of {name}"))


def names_in(where: str, names: Any) -> tuple[str, ...]:
    """Names as a tuple; text, which is a sequence of letters, is refused with a TypeError."""
    if isinstance(names, str):
        raise TypeError(f"{where} = {names!r}: give a tuple of names, such as ('x',) for one")
    return tuple(names)


# -- tracing ------------------------------------------------------------------------------------


def trace(where: str, function: Callable[..., Any], *sizes: int) -> ca.Function:
    """The function, traced for vectors of these sizes; one that is already traced is only checked.

    The last word of `where` becomes its name.
    """
    if isinstance(function, ca.Function):
        given = tuple(function.size1_in(i) for i in range(function.n_in()))
        if given != sizes:
            raise ValueError(f"{where} was traced for inputs of sizes {given}, not {sizes}")
        return function
    if not callable(function):
        raise TypeError(f"{where} = {function!r}: must be a function")
    symbols = [ca.SX.sym(f"in{i}", n) for i, n in enumerate(sizes)]
    try:
        traced = ca.Function(where.split()[-1], symbols, [_column(function(*symbols))])
    except Exception as error:  # a caller's function may raise anything
        raise ValueError(
            f"{where} cannot be traced with symbols of sizes {sizes}: {error}"
        ) from error
    tried = [traced(*(np.full(n, value) for n in sizes)).full() for value in TRIED]
    if not np.isfinite(tried).any(axis=0).all():
        raise ValueError(
            f"{where} is not finite for any arguments tried: use CasADi's functions in it, such as "
            "casadi.sin; functions of math turn symbols into NaN"
        )
    return traced


def require_rows(where: str, function: ca.Function, names: Sequence[str]) -> None:
    """Refuse a function that does not return one number per name, with a ValueError."""
    if function.size1_out(0) != len(names):
        raise ValueError(
            f"{where} gives {function.size1_out(0)} numbers for its {len(names)} names {names}"
        )


def _column(out: Any) -> ca.SX:
    """What a function returned, as a dense column."""
    if isinstance(out, np.ndarray):
        out = list(np.atleast_1d(out))
    entries = out if isinstance(out, Sequence) else [out]
    return ca.densify(ca.vec(ca.SX(ca.vertcat(*entries)))) if entries else ca.SX(0, 1)
