"""From Python functions of symbols to `casadi.Function` objects, checked."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

if TYPE_CHECKING:
    from trajopt.ocp.pose.problem import Phase

#: What functions are called with, by the number of arguments.
ARGUMENTS = {2: ("x", "p"), 3: ("x", "u", "p"), 4: ("starts", "ends", "durations", "p")}

#: Fragments of CasADi's messages for common mistakes, and their remedies.
REMEDIES = {
    "truth value": "branch with casadi.if_else, fmin or fmax, not with if, min or max",
    "out of bounds": "indices count from 0 up to these sizes",
    "SX_get": "indices are integers or slices",
    "iterate": "casadi.vertsplit makes a list of a vector",
    "positional argument": "it is called with these arguments",
    "are free": "it may use symbols of its own arguments alone",
}


def traced_phases(phases: Sequence[Phase], parameters: int) -> Iterator[Phase]:
    """The phases, traced; one that occurs several times is traced once."""
    traced: dict[int, Phase] = {}
    for phase in phases:
        if id(phase) not in traced:
            traced[id(phase)] = _traced_phase(phase, parameters)
        yield traced[id(phase)]


def _traced_phase(phase: Phase, parameters: int) -> Phase:
    nx, nu = len(phase.states), len(phase.controls)
    where, changes = f"phase {phase.name!r}", dict[str, Any]()
    for name in ("flow", "cost", "powers"):
        if name == "flow" or getattr(phase, name) is not None:
            changes[name] = trace(f"{where}: {name}", getattr(phase, name), *(nx, nu, parameters))
    if changes["flow"].size1_out(0) != nx:
        raise ValueError(
            f"{where}: flow gives {changes['flow'].size1_out(0)} rates for the "
            f"{nx} states {phase.states}"
        )
    if "powers" in changes and not changes["powers"].size1_out(0):
        raise ValueError(f"{where}: powers gives no numbers: leave it out")
    if "cost" in changes:
        require_scalar(f"{where}: cost", changes["cost"])
    for name, sizes in (
        ("path", (nx, nu, parameters)),
        ("integral", (nx, nu, parameters)),
        ("at_start", (nx, parameters)),
        ("at_end", (nx, parameters)),
    ):
        constraint = getattr(phase, name)
        if constraint is None:
            continue
        function = trace(f"{where}: {name}", constraint.function, *sizes)
        require_rows(f"{where}: {name}", function, constraint.names)
        changes[name] = dataclasses.replace(constraint, function=function)
    return dataclasses.replace(phase, **changes)


def require_scalar(where: str, function: ca.Function) -> None:
    """Refuse a function that does not return exactly one number."""
    if function.size1_out(0) != 1:
        raise ValueError(f"{where} gives {function.size1_out(0)} numbers, not one: add them up")


def require_rows(where: str, function: ca.Function, names: Sequence[str]) -> None:
    """Refuse a constraint's function that does not return one number per name."""
    if function.size1_out(0) != len(names):
        raise ValueError(
            f"{where} gives {function.size1_out(0)} numbers for its {len(names)} names {names}"
        )


def trace(where: str, function: Callable[..., Any], *sizes: int) -> ca.Function:
    """The function traced for vectors of these sizes; one that is already traced is only checked.

    Args:
        where: what it is, for messages; the last word becomes its name.
        function: what to trace.
        sizes: of its arguments.

    Raises:
        TypeError: it is not a function.
        ValueError: it takes other sizes, fails, returns anything but real numbers and expressions,
            or has a row that is not finite for any of the arguments tried.
    """
    if isinstance(function, ca.Function):
        given = tuple(function.size1_in(i) for i in range(function.n_in()))
        if given != sizes:
            raise ValueError(
                f"{where} was traced for inputs of sizes {given}, here they are {sizes}: parts of "
                "another problem can be used in those with as many parameters"
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
    except Exception as error:  # a user's function may raise anything
        raise ValueError(_failure(where, error, sizes)) from error
    tried = [made(*(np.full(n, value) for n in sizes)).full() for value in (0.3, 0.7, -0.4)]
    if not np.isfinite(tried).any(axis=0).all():
        raise ValueError(
            f"{where} is not finite for any arguments tried: use CasADi's functions in it, such as "
            "casadi.sin; those of math turn symbols into NaN"
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
                f"{where} gives {entry!r}: must be real numbers or CasADi expressions, one or a "
                "sequence of them"
            )
    column = ca.SX(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
    if column.size2() != 1 and column.numel():
        raise _NoNumbersError(
            f"{where} gives a matrix of shape {column.shape}: must be one column; casadi.vec "
            "makes one of it"
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
