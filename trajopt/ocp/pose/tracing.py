"""Tracing: from a Python function of CasADi symbols to a checked `casadi.Function`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

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
}


def require_scalar(where: str, function: ca.Function) -> None:
    """Refuse a function that does not return exactly one number.

    Raises:
        ValueError: it returns none or several.
    """
    if function.size1_out(0) != 1:
        raise ValueError(f"{where} gives {function.size1_out(0)} numbers, not one: add them up")


def require_rows(where: str, function: ca.Function, names: Sequence[str]) -> None:
    """Refuse a constraint's function that does not return one number per name.

    Raises:
        ValueError: it returns more or fewer.
    """
    if function.size1_out(0) != len(names):
        raise ValueError(
            f"{where} gives {function.size1_out(0)} numbers for its {len(names)} names {names}"
        )


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
        column = _column(where, function(*symbols))
        made = ca.Function(where.split()[-1], symbols, [column])
    except _NoNumbersError as error:
        raise ValueError(str(error)) from None
    except Exception as error:  # a caller's function may raise anything
        raise ValueError(_failure(where, error, sizes)) from error
    tried = [made(*(np.full(n, value) for n in sizes)).full() for value in (0.3, 0.7, -0.4)]
    if not np.isfinite(tried).any(axis=0).all():
        raise ValueError(
            f"{where} is not finite for any arguments tried: use CasADi's functions in it, such as "
            "casadi.sin; functions of math turn symbols into NaN"
        )
    return made


class _NoNumbersError(Exception):
    """A function returned something other than real numbers and expressions."""


def _column(where: str, out: Any) -> ca.SX:
    """What a function returned, as a dense column."""
    if out is None:
        raise _NoNumbersError(f"{where} gives None: end it with return")
    if isinstance(out, np.ndarray):
        out = list(np.atleast_1d(out))
    entries = out if isinstance(out, Sequence) and not isinstance(out, (str, bytes)) else [out]
    for entry in entries:
        if isinstance(entry, (str, bytes, complex)) or not _is_numeric(entry):
            raise _NoNumbersError(
                f"{where} gives {entry!r}: must be a real number, a CasADi expression, or a "
                "sequence of them"
            )
    column = ca.SX(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
    if column.size2() != 1 and column.numel():
        raise _NoNumbersError(
            f"{where} gives a matrix of shape {column.shape}: must be one column, which "
            "casadi.vec makes of it"
        )
    return ca.densify(column)


def _is_numeric(entry: Any) -> bool:
    try:
        ca.SX(entry)
    except (NotImplementedError, TypeError):
        return False
    return True


def _failure(where: str, error: Exception, sizes: Sequence[int]) -> str:
    inputs = zip(ARGUMENTS[len(sizes)], sizes, strict=True)
    called = ", ".join(f"{name} ({size})" for name, size in inputs)
    text = str(error).strip() or "no reason given"
    said = re.sub(r"^\.\.\./\S+: ", "", text.splitlines()[-1].strip())
    remedy = next((f"; {hint}" for sign, hint in REMEDIES.items() if sign in text), "")
    return (
        f"{where} cannot be traced with symbols of sizes {called}: "
        f"{type(error).__name__}: {said}{remedy}"
    )
