"""Tracing: a function of scalars is run on symbols, and what it computes becomes a graph.

Where the function branches on a symbol, it is run again for either outcome, so that every branch
of it is traced.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Callable, Mapping
from types import FunctionType, ModuleType
from typing import Any, TypeAlias

Tree: TypeAlias = "Leaf | Branch"


@dataclasses.dataclass(frozen=True)
class Leaf:
    """What a function returns at the end of one of its branches: an expression, or several."""

    value: Any


@dataclasses.dataclass(frozen=True)
class Branch:
    """A condition, and what the function does in either case."""

    condition: Symbol
    yes: Tree
    no: Tree


class Undecided(Exception):
    """The traced function branches on a condition that has not been decided."""

    def __init__(self, condition: Symbol) -> None:
        self.condition = condition


class Graph:
    """Expressions; equal ones are the same `Symbol`."""

    def __init__(self) -> None:
        self.decided: Mapping[Symbol, bool] = {}
        self._known: dict[tuple[Any, ...], Symbol] = {}

    def symbol(self, kind: str, *parts: Any) -> Symbol:
        """The expression of this kind and these parts: symbols, numbers or names."""
        key = kind, *((type(part), part) for part in parts)
        if key not in self._known:
            self._known[key] = Symbol(self, kind, parts)
        return self._known[key]

    def function(self, name: str) -> Callable[..., Any]:
        """A function that is called by name in the program, such as Math.sin."""
        return functools.partial(self.symbol, name)

    def trace(self, function: Callable[..., Any], *arguments: Any) -> Tree:
        """Everything that a function does with its arguments."""

        def explored(decided: Mapping[Symbol, bool]) -> Tree:
            self.decided = decided
            try:
                return Leaf(function(*arguments))
            except Undecided as missing:
                case = missing.condition
            yes, no = (explored({**decided, case: answer}) for answer in (True, False))
            return Branch(case, yes, no)

        return explored({})


def _binary(kind: str) -> Any:
    def combined(self: Symbol, other: Any) -> Symbol:
        return self.graph.symbol(kind, self, other)

    return combined


def _reflected(kind: str) -> Any:
    def combined(self: Symbol, other: Any) -> Symbol:
        return self.graph.symbol(kind, other, self)

    return combined


class Symbol:
    """An expression. Arithmetic and comparisons with it give further expressions.

    Attributes:
        graph: that it belongs to.
        kind: "input", an operator, or the name of a function.
        parts: what the operator or function is applied to; of an input, its name.
    """

    __slots__ = ("graph", "kind", "parts")

    def __init__(self, graph: Graph, kind: str, parts: tuple[Any, ...]) -> None:
        self.graph, self.kind, self.parts = graph, kind, parts

    __add__, __radd__ = _binary("+"), _reflected("+")
    __sub__, __rsub__ = _binary("-"), _reflected("-")
    __mul__, __rmul__ = _binary("*"), _reflected("*")
    __truediv__, __rtruediv__ = _binary("/"), _reflected("/")
    __lt__, __le__, __gt__, __ge__ = map(_binary, ("<", "<=", ">", ">="))
    __eq__, __ne__ = _binary("==="), _binary("!==")
    __hash__ = object.__hash__

    def __neg__(self) -> Symbol:
        return self.graph.symbol("negative", self)

    def __abs__(self) -> Symbol:
        return self.graph.symbol("Math.abs", self)

    def __pow__(self, exponent: int) -> Symbol:
        return functools.reduce(operator.mul, [self] * exponent)

    def __bool__(self) -> bool:
        if self not in self.graph.decided:
            raise Undecided(self)
        return self.graph.decided[self]


def retold(module: ModuleType, **names: Any) -> dict[str, Any]:
    """A module's names, its functions told again with other things under the given names."""
    told = {**vars(module), **names}
    for name, value in vars(module).items():
        own = isinstance(value, FunctionType) and value.__module__ == module.__name__
        if own and name not in names and value.__closure__ is None:
            told[name] = FunctionType(value.__code__, told, name, value.__defaults__)
    return told
