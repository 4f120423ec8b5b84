"""From Python functions of symbols to `casadi.Function` objects, checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

if TYPE_CHECKING:
    from trajopt.problem import Phase


def traced_phases(phases: Sequence[Phase], parameters: int) -> Iterator[Phase]:
    """Traced once where the same one stands in several places."""
    traced: dict[int, Phase] = {}
    for phase in phases:
        if id(phase) not in traced:
            traced[id(phase)] = _traced_phase(phase, parameters)
        yield traced[id(phase)]


def _traced_phase(phase: Phase, parameters: int) -> Phase:
    nx, nu = len(phase.states), len(phase.controls)
    changes: dict[str, Any] = {}
    for name in ("flow", "cost", "powers"):
        if getattr(phase, name) is not None:
            changes[name] = trace(name, getattr(phase, name), nx, nu, parameters)
    if changes["flow"].size1_out(0) != nx:
        raise ValueError(
            f"phase {phase.name!r}: flow gives {changes['flow'].size1_out(0)} rates for the "
            f"{nx} states {phase.states}"
        )
    if "cost" in changes and changes["cost"].size1_out(0) != 1:
        raise ValueError(
            f"phase {phase.name!r}: cost gives {changes['cost'].size1_out(0)} numbers, not one"
        )
    for name, sizes in (
        ("path", (nx, nu, parameters)),
        ("integral", (nx, nu, parameters)),
        ("at_start", (nx, parameters)),
        ("at_end", (nx, parameters)),
    ):
        constraint = getattr(phase, name)
        if constraint is None:
            continue
        function = trace(name, constraint.function, *sizes)
        if function.size1_out(0) != len(constraint.names):
            raise ValueError(
                f"phase {phase.name!r}: {name} gives {function.size1_out(0)} numbers for its "
                f"{len(constraint.names)} names {constraint.names}"
            )
        changes[name] = dataclasses.replace(constraint, function=function)
    return dataclasses.replace(phase, **changes)


def trace(name: str, function: Callable[..., Any], *sizes: int) -> ca.Function:
    """The function of vectors of these sizes; one that is traced already is only checked.

    Raises:
        ValueError: it takes other sizes, or gives NaN whatever it is given.
    """
    if isinstance(function, ca.Function):
        given = tuple(function.size1_in(i) for i in range(function.n_in()))
        if given != sizes:
            raise ValueError(
                f"{name} was traced for inputs of sizes {given}, here they are {sizes}: parts of "
                "another problem can be used in those with as many parameters"
            )
        return function
    symbols = [ca.SX.sym(f"in{i}", n) for i, n in enumerate(sizes)]
    out = function(*symbols)
    column = ca.vertcat(*out) if isinstance(out, Sequence) else out
    made = ca.Function(name, symbols, [ca.densify(ca.SX(column))])
    tried = [made(*(np.full(n, value) for n in sizes)).full() for value in (0.3, 0.7, -0.4)]
    if np.isnan(tried).all(axis=0).any():
        raise ValueError(
            f"{name} is not a number, whatever its arguments: use CasADi's functions in it, such "
            "as casadi.sin; those of math make NaN of symbols"
        )
    return made
