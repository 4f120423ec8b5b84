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

#: The arguments of functions, by their number.
ARGUMENTS = {2: ("x", "p"), 3: ("x", "u", "p"), 4: ("starts", "ends", "durations", "p")}

#: Remedies for common mistakes, by what occurs in CasADi's message.
REMEDIES = {
    "truth value": "branch with casadi.if_else, fmin or fmax, not with if, min or max",
    "out of bounds": "indices count from 0 up to these sizes",
    "SX_get": "indices are integers or slices",
    "iterate": "casadi.vertsplit makes a list of a vector",
    "positional argument": "it is called with these arguments",
    "are free": "it may use only symbols of its own arguments",
    "You have": "it must give real numbers, CasADi expressions, or a sequence of them",
}


#: Violations below this are rounding.
NOTEWORTHY = 1e-9


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
        """Check that every name has bounds, and that the bounds leave room."""
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


@dataclasses.dataclass(frozen=True)
class Violation:
    """A constraint or bound that is violated.

    Attributes:
        kind: of constraint, see `trajopt.ocp.equations.Rows`; "bound" for bounds.
        name: of the row.
        phase: name of the phase; empty for the problem as a whole.
        time: from the phase's start (s).
        amount: of the violation.
    """

    kind: str
    name: str
    phase: str
    time: float
    amount: float

    def __str__(self) -> str:
        """A line for a report."""
        where = f" of phase {self.phase!r} at t = {self.time:.6g} s" if self.phase else ""
        name = f" of {self.name}" if self.name else ""
        return f"{self.kind}{name}{where} violated by {self.amount:.1e}"


def nonnegative(function: Expression, *names: str) -> Constraint:
    """The constraint ``function(...) >= 0``, row by row."""
    return Constraint(function, np.zeros(len(names)), np.full(len(names), np.inf), names)


def equal(function: Expression, values: Sequence[float], *names: str) -> Constraint:
    """The constraint ``function(...) == values``, row by row."""
    return Constraint(function, values, values, names)  # type: ignore[arg-type]


def require_constraint(where: str, constraint: Any) -> None:
    """Refuse anything but a constraint or None, with a TypeError."""
    if constraint is not None and not isinstance(constraint, Constraint):
        raise TypeError(
            f"{where} = {constraint!r}: must be a Constraint; `equal` and `nonnegative` make some"
        )


# -- bounds and names ---------------------------------------------------------------------------


def pair(bounds: float | tuple[float, float], where: str = "bounds") -> tuple[float, float]:
    """Bounds as (lower, upper); one number stands for both.

    Args:
        bounds: of any type.
        where: what is bounded, for messages.

    Raises:
        TypeError: they are neither a number nor a pair of numbers.
    """
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
    """Refuse a table with invalid bounds or, where `known` is given, with an unknown name.

    Raises:
        InfeasibleBoundsError: no number lies between the bounds of a name.
        TypeError: it is not a mapping from names to bounds.
        ValueError: it has an unknown name.
    """
    if not isinstance(table, Mapping) or not all(isinstance(name, str) for name in table):
        raise TypeError(f"{where} = {table!r}: must be a mapping, name: (lower, upper)")
    unknown = [name for name in table if known is not None and name not in known]
    if unknown:
        raise ValueError(f"{where} names {unknown}, which are not among {known}")
    for name, bounds in table.items():
        require_room(f"{where} of {name}", *pair(bounds, f"{where} of {name}"))


def names_in(where: str, names: Any, least: int = 0) -> tuple[str, ...]:
    """Names as a tuple.

    Raises:
        TypeError: they are not a sequence of strings.
        ValueError: there are fewer than `least`.
    """
    text = isinstance(names, str) or not isinstance(names, Sequence)
    if text or not all(isinstance(name, str) for name in names):
        raise TypeError(f"{where} = {names!r}: give a tuple of names, such as ('x',) for one")
    if len(names) < least:
        raise ValueError(f"{where} = {names!r}: give at least {least}")
    return tuple(names)


# -- tracing ------------------------------------------------------------------------------------


def trace(where: str, function: Callable[..., Any], *sizes: int) -> ca.Function:
    """The function, traced for vectors of these sizes.

    Args:
        where: what it is, for messages; the last word becomes its name.
        function: what to trace. One that is already traced is only checked.
        sizes: of its arguments.

    Raises:
        TypeError: it is not a function.
        ValueError: it takes other sizes, fails, returns something other than real numbers and
            expressions, or has a row that is not finite for any of the arguments tried.
    """
    if isinstance(function, ca.Function):
        given = tuple(function.size1_in(i) for i in range(function.n_in()))
        if given != sizes:
            raise ValueError(
                f"{where} was traced for inputs of sizes {given}, here they are {sizes}: it can be "
                "used again only in a problem with as many states, controls and parameters"
            )
        return function
    if not callable(function):
        raise TypeError(f"{where} = {function!r}: must be a function")
    symbols = [ca.SX.sym(f"in{i}", n) for i, n in enumerate(sizes)]
    try:
        traced = ca.Function(where.split()[-1], symbols, [_column(function(*symbols))])
    except Exception as error:  # a caller's function may raise anything
        raise ValueError(_failure(where, error, sizes)) from error
    tried = [traced(*(np.full(n, value) for n in sizes)).full() for value in (0.3, 0.7, -0.4)]
    if not np.isfinite(tried).any(axis=0).all():
        raise ValueError(
            f"{where} is not finite for any arguments tried: use CasADi's functions in it, such as "
            "casadi.sin; functions of math turn symbols into NaN"
        )
    return traced


def require_scalar(where: str, function: ca.Function) -> None:
    """Refuse a function that does not return exactly one number, with a ValueError."""
    if function.size1_out(0) != 1:
        raise ValueError(f"{where} gives {function.size1_out(0)} numbers, not one: add them up")


def require_rows(where: str, function: ca.Function, names: Sequence[str]) -> None:
    """Refuse a function that does not return one number per name, with a ValueError."""
    if function.size1_out(0) != len(names):
        raise ValueError(
            f"{where} gives {function.size1_out(0)} numbers for its {len(names)} names {names}"
        )


def _column(out: Any) -> ca.SX:
    """What a function returned, as a dense column."""
    if out is None:
        raise ValueError("it gives None: end it with return")
    if isinstance(out, np.ndarray):
        out = list(np.atleast_1d(out))
    entries = out if isinstance(out, Sequence) and not isinstance(out, (str, bytes)) else [out]
    column = ca.SX(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
    if column.size2() != 1 and column.numel():
        raise ValueError(f"it gives a matrix of shape {column.shape}: casadi.vec makes one column")
    return ca.densify(column)


def _failure(where: str, error: Exception, sizes: Sequence[int]) -> str:
    inputs = zip(ARGUMENTS[len(sizes)], sizes, strict=True)
    called = ", ".join(f"{name} ({size})" for name, size in inputs)
    text = str(error).strip() or "no reason given"
    remedy = next((f"; {hint}" for sign, hint in REMEDIES.items() if sign in text), "")
    return (
        f"{where} cannot be traced with symbols of sizes {called}: "
        f"{type(error).__name__}: {text.splitlines()[-1].strip()}{remedy}"
    )
