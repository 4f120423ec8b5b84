"""Constraints: expressions with bounds and names."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.checks import real_array
from trajopt.ocp.pose.bounds import names_in, require_room

#: A Python function of CasADi symbols, mostly (x, u, p), that returns a scalar or a sequence of
#: scalars; or the `casadi.Function` traced from it.
Expression: TypeAlias = Callable[..., Any]


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


def nonnegative(function: Expression, *names: str) -> Constraint:
    """The constraint ``function(...) >= 0``, row by row."""
    return Constraint(function, np.zeros(len(names)), np.full(len(names), np.inf), names)


def equal(function: Expression, values: Sequence[float], *names: str) -> Constraint:
    """The constraint ``function(...) == values``, row by row."""
    return Constraint(function, values, values, names)  # type: ignore[arg-type]


def require_constraint(where: str, constraint: Any) -> None:
    """Refuse anything but a constraint or None.

    Raises:
        TypeError: it is something else.
    """
    if constraint is not None and not isinstance(constraint, Constraint):
        raise TypeError(
            f"{where} = {constraint!r}: must be a Constraint; `equal` and `nonnegative` make some"
        )
