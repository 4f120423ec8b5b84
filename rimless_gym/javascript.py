"""The simulator as one JavaScript text, for browsers and Node.

The physics is not written again: the lines of `rimless_gym.equations` and `rimless_gym.hybrid` that
numba compiles and CasADi traces are traced here too, and printed. A function of scalars is run on
symbols, and what it computes becomes a graph; where it branches on a symbol, it is run again for
either outcome. A machine's constants are an object ``p``, computed from its parameters by the
traced `constants_of`, so that a page can change the machine. The stepper is `stepping.js`.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.resources import files
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any, TypeAlias

from scipy.integrate import DOP853

from rimless_gym import hybrid
from rimless_gym.envs import layout as observing
from rimless_gym.equations import IMPACT_LAWS, LOSSES, equations
from rimless_gym.params import CHOICES, Constants, WheelParams, constants_of

#: What the text gives to those that use it.
_EXPORTED = (
    *("constants", "advance", "atRest", "rates", "observation", "electrical_power"),
    *("relative_rate", "motor_current", "motor_voltage", "hub_position", "pendulum_clearance"),
    *("after_touchdown", "after_lift_off", "ground_reaction", "mechanical_energy"),
    *("CONTROL_PERIOD", "LOSSES", "OK", "SINGLE", "DOUBLE"),
)


def simulator(params: WheelParams) -> str:
    """JavaScript that defines `wheel`, an object of functions; it needs nothing else.

    ``wheel.constants(machine)`` gives the constants of a machine, an object with the fields of
    `WheelParams`; ``wheel.advance(state, volts, seconds, constants)`` advances a wheel; see
    `stepping.js`, and `rimless_gym.javascript` for what `params` decides.
    """
    tableau = {"A": DOP853.A, "B": DOP853.B, "E3": DOP853.E3, "E5": DOP853.E5}
    stepping = (files("rimless_gym") / "stepping.js").read_text(encoding="utf-8")
    parts = [
        physics(params),
        *(f"const {name} = {json.dumps(weights.tolist())};" for name, weights in tableau.items()),
        stepping,
        f"return {{ {', '.join(_EXPORTED)} }};",
    ]
    body = "\n\n".join(parts)
    return f"const wheel = (() => {{\n'use strict';\n{body}\n}})();\n"


#: The equations, and the rules of the hybrid automaton, that the stepper and the page need.
EQUATIONS = (
    *("motor_charge", "motor_current", "motor_voltage", "electrical_power", "relative_rate"),
    *("touchdown_guard", "lift_off_guard", "contact_guard", "ground_reaction", "friction_demand"),
    *("pendulum_clearance", "mechanical_energy", "linear_momentum", "hub_position", "descent"),
)
AUTOMATON = ("after_touchdown", "after_lift_off", "both_feet_press")

#: Numbers of the simulator that the stepper needs too.
LIMITS = (
    *("CONTROL_PERIOD", "MAX_RATE", "MAX_EVENTS"),
    *("OK", "CONTACT_LOST", "RATE_EXCEEDED", "TOO_MANY_EVENTS", "THESIS_BACKWARD", "DIVERGED"),
)

#: Fields of a machine that the JavaScript cannot change: their values are built in.
BUILT_IN = ("n_legs", *CHOICES)


def physics(params: WheelParams) -> str:
    """JavaScript that defines the functions of the model, and `constants(machine)`.

    Args:
        params: the machine. Its number of legs, motor mount and impact law are built in, and
            whether its pendulum's reach follows from its length; all else is read from the
            `machine` object, whose fields are those of `WheelParams`.

    Returns:
        The text of functions that take angles in rad, rates in rad/s, voltage ``u`` in V and
        the constants ``p``. ``motion_single`` and ``motion_double`` return the rates of the state
        and the powers of the `LOSSES`, in this order.
    """
    graph, law = Graph(), float(IMPACT_LAWS.index(params.impact_law))
    machine = Constants(*(graph.symbol("input", f"p.{name}") for name in Constants._fields))
    machine = machine._replace(law=law)
    eq = _equations(graph)
    rules = rebound(hybrid, math=_maths(graph), max=graph.function("Math.max"), **vars(eq))
    seen = rebound(
        observing,
        **{name: graph.function(f"Math.{name}") for name in ("sin", "cos", "min", "max")},
    )
    functions = [
        *(getattr(eq, name) for name in EQUATIONS),
        *(rules[name] for name in AUTOMATON),
        *_motions(eq),
        seen["observation"],
    ]
    return "\n\n".join(
        [
            "\n".join(f"const {name} = {getattr(hybrid, name)!r};" for name in LIMITS),
            f"const LOSSES = {list(LOSSES)!r};",
            _constants_text(params, law),
            *(_function_text(graph, function, machine) for function in functions),
        ]
    )


def _maths(graph: Graph) -> SimpleNamespace:
    functions = {name: graph.function(f"Math.{name}") for name in ("sin", "cos", "sqrt", "hypot")}
    return SimpleNamespace(pi=math.pi, inf=math.inf, **functions)


def _equations(graph: Graph) -> SimpleNamespace:
    maths = _maths(graph)
    return equations(maths.sin, maths.cos, sqrt=maths.sqrt)


def _motions(eq: SimpleNamespace) -> list[Callable[..., Any]]:
    """The rates of the state and of the energies lost, in either stance mode."""

    def motion(dphi: Any, dtheta: Any, acc: tuple[Any, Any], u: Any, p: Any) -> tuple[Any, ...]:
        dpsi, ddpsi = eq.relative_rate(dphi, dtheta, p), eq.relative_rate(*acc, p)
        return (dphi, dtheta, *acc, *tuple(eq.losses(dphi, dpsi, ddpsi, u, p)))

    def motion_single(phi, theta, dphi, dtheta, u, p):  # type: ignore[no-untyped-def]
        return motion(dphi, dtheta, eq.single_stance(phi, theta, dphi, dtheta, u, p), u, p)

    def motion_double(phi, theta, dphi, dtheta, u, p):  # type: ignore[no-untyped-def]
        standing = eq.double_stance(phi, theta, dphi, dtheta, u, p)
        return motion(dphi, dtheta, (0.0, standing), u, p)

    return [motion_single, motion_double]


def _function_text(graph: Graph, function: Callable[..., Any], machine: Constants) -> str:
    names = list(inspect.signature(function).parameters)
    inputs = [machine if name == "p" else graph.symbol("input", name) for name in names]
    return function_text(function.__name__, names, graph.trace(function, *inputs))


def _constants_text(params: WheelParams, law: float) -> str:
    """The function from a machine's fields to its constants."""
    graph, values = Graph(), params.to_dict()
    fixed = [name for name in values if name in BUILT_IN or values[name] is None]
    fields = {n: v if n in fixed else graph.symbol("input", f"m.{n}") for n, v in values.items()}
    maths, d1 = _maths(graph), 1.0 if params.motor_mount == "wheel" else 0.0

    def values_of(machine: Any) -> Any:
        return constants_of(machine, d1, law, maths.sin, maths.cos)

    return function_text("constants", ["m"], graph.trace(values_of, SimpleNamespace(**fields)))


# -- Tracing -------------------------------------------------------------------------------------

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


def rebound(module: ModuleType, **names: Any) -> dict[str, Any]:
    """A module's names, its functions with other things under the given names."""
    scope = {**vars(module), **names}
    for name, value in vars(module).items():
        defined_here = isinstance(value, FunctionType) and value.__module__ == module.__name__
        if defined_here and name not in names and value.__closure__ is None:
            scope[name] = FunctionType(value.__code__, scope, name, value.__defaults__)
    return scope


# -- Printing: what is needed twice is computed once ---------------------------------------------

_OPERATORS = ("+", "-", "*", "/", "<", "<=", ">", ">=", "===", "!==")


def function_text(name: str, parameters: Iterable[str], tree: Tree) -> str:
    """A function's definition.

    Args:
        name: of the function.
        parameters: their names.
        tree: what it returns, by branches: numbers, expressions, or named or plain tuples of them.
            Named tuples become objects, plain ones arrays.
    """
    body = "\n".join(_block(tree, {}, "  "))
    return f"function {name}({', '.join(parameters)}) {{\n{body}\n}}"


def _expressions(value: Any) -> Iterator[Symbol]:
    if isinstance(value, Symbol):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from _expressions(part)


def _roots(tree: Tree) -> Iterator[Symbol]:
    """The expressions that a tree needs, those of its branches included."""
    if isinstance(tree, Leaf):
        yield from _expressions(tree.value)
    else:
        yield tree.condition
        yield from _roots(tree.yes)
        yield from _roots(tree.no)


def _needed_twice(tree: Tree) -> set[Symbol]:
    """The expressions that are worth a name."""
    uses: Counter[Symbol] = Counter()
    waiting = list(_roots(tree))
    while waiting:
        symbol = waiting.pop()
        uses[symbol] += 1
        if uses[symbol] == 1:
            waiting += _expressions(symbol.parts)
    return {symbol for symbol, count in uses.items() if count > 1 and symbol.kind != "input"}


def _block(tree: Tree, names: dict[Symbol, str], indent: str) -> list[str]:
    """The lines of a tree; `names` are those of expressions computed before it."""
    names, shared, lines = dict(names), _needed_twice(tree), list[str]()

    def name(symbol: Symbol) -> None:
        """Name what the expression shares with others, the innermost first."""
        if symbol in names:
            return
        for part in _expressions(symbol.parts):
            name(part)
        if symbol in shared:
            text = _text(symbol, names)
            names[symbol] = f"t{len(names)}"
            lines.append(f"{indent}const {names[symbol]} = {text};")

    now = tree.value if isinstance(tree, Leaf) else tree.condition
    for symbol in _expressions(now):
        name(symbol)
    if isinstance(tree, Leaf):
        return [*lines, f"{indent}return {_text(now, names)};"]
    yes = _block(tree.yes, names, f"{indent}  ")
    no = _block(tree.no, names, indent)
    return [*lines, f"{indent}if ({_text(now, names)}) {{", *yes, f"{indent}}}", *no]


def _text(value: Any, names: dict[Symbol, str]) -> str:
    """An expression as it stands; in a larger one, `_inner` is what it becomes."""
    if isinstance(value, Symbol):
        return _symbol_text(value, names)
    if isinstance(value, tuple):
        parts = [_text(part, names) for part in value]
        if not hasattr(value, "_fields"):
            return f"[{', '.join(parts)}]"
        return f"{{{', '.join(f'{k}: {v}' for k, v in zip(value._fields, parts, strict=True))}}}"
    if isinstance(value, bool):
        return "true" if value else "false"
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return repr(value)


def _symbol_text(symbol: Symbol, names: dict[Symbol, str]) -> str:
    if symbol in names:
        return names[symbol]
    kind, parts = symbol.kind, symbol.parts
    if kind == "input":
        return str(parts[0])
    if kind == "negative":
        return f"-{_inner(parts[0], names)}"
    if kind in _OPERATORS:
        return f"{_inner(parts[0], names)} {kind} {_inner(parts[1], names)}"
    return f"{kind}({', '.join(_text(part, names) for part in parts)})"


def _inner(value: Any, names: dict[Symbol, str]) -> str:
    text = _text(value, names)
    return f"({text})" if " " in text or text.startswith("-") else text
