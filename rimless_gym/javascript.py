"""The simulator as one JavaScript text, for browsers and Node.

The physics is not written again: the functions of `rimless_gym.equations`, `rimless_gym.hybrid` and
others that numba compiles and CasADi traces are printed here, line by line, from their syntax
trees (`rimless_gym.tracing`). Named tuples become objects, plain ones arrays. The stepper is
`stepping.js`.
"""

from __future__ import annotations

import ast
import json
from importlib.resources import files
from types import ModuleType

from scipy.integrate import DOP853

from rimless_gym import equations, hybrid, params
from rimless_gym.envs import layout
from rimless_gym.tracing import names_within, syntax_trees

#: The functions that are printed, by the module they stand in; of the equations, all.
PRINTED: dict[ModuleType, tuple[str, ...]] = {
    equations: names_within(equations.equations),
    params: ("leg_angle_of", "step_length_of", "reach_of", "rod_reach", "constants_of"),
    hybrid: ("both_feet_press", "rocks_too_fast", "after_touchdown", "after_lift_off"),
    layout: ("observation", "_within"),
}

#: Numbers and names that the functions and the stepper need too.
CONSTANTS = {
    equations: ("SINGLE", "DOUBLE", "IMPACT_LAWS", "RELABEL", "THESIS"),
    hybrid: (
        *("CONTROL_PERIOD", "MAX_RATE", "MAX_EVENTS", "REST_ENERGY", "SHORTEST_ROCKING"),
        *("OK", "CONTACT_LOST", "RATE_EXCEEDED", "TOO_MANY_EVENTS", "THESIS_BACKWARD", "DIVERGED"),
    ),
    layout: ("LEG_RATE_SCALE", "PENDULUM_RATE_SCALE"),
}

#: What Python's functions and `math` are in JavaScript. V8's `x ** 2` is not always `x * x`.
_PRELUDE = """\
const { abs, cos, max, min, sin, sqrt } = Math;
const math = { pi: Math.PI, inf: Infinity, sin, hypot: Math.hypot };
const power = (x, n) => (n > 1 ? x * power(x, n - 1) : x);"""

#: Operators by the names of their syntax nodes.
_ARITHMETIC = {"Add": "+", "Sub": "-", "Mult": "*", "Div": "/", "USub": "-"}
_COMPARISON = {"Lt": "<", "LtE": "<=", "Gt": ">", "GtE": ">=", "Eq": "===", "Is": "==="}
_OPERATORS = _ARITHMETIC | _COMPARISON | {"Not": "!", "And": "&&", "Or": "||"}


def simulator() -> str:
    """JavaScript that defines `wheel`, an object of functions; it needs nothing else.

    ``wheel.constants(machine)`` gives the constants of a machine, an object with the fields of
    `WheelParams`; ``wheel.advance(state, volts, seconds, constants)`` advances a wheel. Angles are
    in rad, rates in rad/s. See `stepping.js`, whose last line lists all that `wheel` has.
    """
    constants = {name: getattr(m, name) for m, names in CONSTANTS.items() for name in names}
    constants |= {"LOSSES": list(equations.LOSSES)}
    constants |= {name: getattr(DOP853, name).tolist() for name in ("A", "B", "E3", "E5")}
    parts = [
        _PRELUDE,
        "\n".join(f"const {name} = {json.dumps(value)};" for name, value in constants.items()),
        f"const Landing = ({(names := ', '.join(hybrid.Landing._fields))}) => ({{ {names} }});",
        *(_function(node) for _, node in syntax_trees(PRINTED)),
        (files("rimless_gym") / "stepping.js").read_text(encoding="utf-8"),
    ]
    body = "\n\n".join(parts)
    return f"const wheel = (() => {{\n'use strict';\n{body}}})();\n"


def _function(node: ast.FunctionDef) -> str:
    stored = (n for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))
    names = sorted({name.id for name in stored})
    lines = [f"  let {', '.join(names)};"] if names else []
    lines += [f"  {_statement(statement)}" for statement in node.body]
    head = f"function {node.name}({', '.join(argument.arg for argument in node.args.args)}) {{"
    return "\n".join([head, *(line for line in lines if line.strip()), "}"])


def _statement(node: ast.stmt) -> str:
    match node:
        case ast.Return(value=ast.expr() as value):
            return f"return {_text(value)};"
        case ast.Assign(targets=[target], value=value):
            return f"{_text(target)} = {_text(value)};"
        case ast.If(test=test, body=body, orelse=orelse):
            yes, no = (" ".join(map(_statement, block)) for block in (body, orelse))
            return f"if ({_text(test)}) {{ {yes} }} else {{ {no} }}"
        case ast.Expr(value=ast.Constant()):  # a docstring
            return ""
    raise NotImplementedError(f"no JavaScript for {ast.unparse(node)}")


def _text(node: ast.expr) -> str:
    match node:
        case ast.Constant(value=value):
            return json.dumps(value)
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=value, attr=name):
            return f"{_text(value)}.{name}"
        case ast.Subscript(value=value, slice=index):
            return f"{_text(value)}[{_text(index)}]"
        case ast.Tuple(elts=parts):
            return f"[{', '.join(map(_text, parts))}]"
        case ast.Call(args=[], keywords=fields):  # a named tuple
            return f"({{ {', '.join(f'{one.arg}: {_text(one.value)}' for one in fields)} }})"
        case ast.Call(func=function, args=arguments, keywords=[]):
            return f"{_text(function)}({', '.join(map(_text, arguments))})"
        case ast.BinOp(left=left, op=ast.Pow(), right=exponent):
            return f"power({_text(left)}, {_text(exponent)})"
        case ast.BinOp(left=left, op=operator, right=right):
            return f"({_text(left)} {_sign(operator)} {_text(right)})"
        case ast.UnaryOp(op=operator, operand=operand):
            return f"({_sign(operator)}{_text(operand)})"
        case ast.BoolOp(op=operator, values=values):
            return f"({f' {_sign(operator)} '.join(map(_text, values))})"
        case ast.IfExp(test=test, body=yes, orelse=no):
            return f"({_text(test)} ? {_text(yes)} : {_text(no)})"
        case ast.Compare(left=left, ops=operators, comparators=others):
            sides = zip([left, *others], operators, others, strict=False)
            both = (f"{_text(a)} {_sign(op)} {_text(b)}" for a, op, b in sides)
            return f"({' && '.join(both)})"
    raise NotImplementedError(f"no JavaScript for {ast.unparse(node)}")


def _sign(operator: ast.AST) -> str:
    return _OPERATORS[type(operator).__name__]
