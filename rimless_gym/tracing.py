"""Functions of scalars as syntax trees: for printing in another language, and for tracing arrays.

The physics is written as plain functions that use little of Python: arithmetic, comparisons,
branches, tuples and each other. `rimless_gym.javascript` prints them. A tracer such as JAX's cannot
follow their branches, because it has no values to decide by; `joined` evaluates all of them, and
joins the results.
"""

from __future__ import annotations

import ast
import inspect
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import CodeType, ModuleType, SimpleNamespace
from typing import Any


def syntax_trees(
    sources: Mapping[ModuleType, Sequence[str]],
) -> Iterator[tuple[ModuleType, ast.FunctionDef]]:
    """The functions with these names, also where they stand inside another function."""
    for module, names in sources.items():
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            if isinstance(node, ast.FunctionDef) and node.name in names:
                yield module, node


def names_within(function: Callable[..., Any]) -> tuple[str, ...]:
    """The names of the functions that `function` defines in its body."""
    (outer,) = ast.parse(inspect.getsource(function)).body
    assert isinstance(outer, ast.FunctionDef)
    return tuple(node.name for node in outer.body if isinstance(node, ast.FunctionDef))


def joined(
    sources: Mapping[ModuleType, Sequence[str]],
    where: Callable[[Any, Any, Any], Any],
    **names: Any,
) -> SimpleNamespace:
    """The functions with these names, for numbers whose values are not known.

    A condition that is a Python bool is decided as usual. For any other, both branches are
    evaluated, and `where(condition, yes, no)` joins the numbers in their results.

    Args:
        sources: names of functions by module.
        where: joins two numbers.
        names: what names in the functions stand for; all others stand for the functions of
            `sources`, and then for what they stand for in the module.
    """
    found: dict[str, Any] = {}

    def join(test: Any, yes: Any, no: Any) -> Any:
        if isinstance(test, bool):
            return yes if test else no
        if not isinstance(yes, tuple):
            return where(test, yes, no)
        parts = [join(test, *both) for both in zip(yes, no, strict=True)]
        return type(yes)(*parts) if hasattr(yes, "_fields") else tuple(parts)

    own = {"_join": join, "_all": _all, "_any": _any, "_not": _not}
    for module, node in syntax_trees(sources):
        scope = ChainMap(own | names, found, vars(module))
        found[node.name] = _function(node, scope, join)
    return SimpleNamespace(**found)


def _function(node: ast.FunctionDef, scope: ChainMap[str, Any], join: Any) -> Callable[..., Any]:
    arguments = [argument.arg for argument in node.args.args]
    body = [_Eager().visit(statement) for statement in node.body]
    codes = {
        id(part): compile(ast.fix_missing_locations(ast.Expression(part)), node.name, "eval")
        for statement in body
        for part in _expressions(statement)
    }

    def traced(*values: Any) -> Any:
        known = dict(zip(arguments, values, strict=True))
        run = _Run(scope.new_child(known), codes, join)
        run.block(body, True)
        result = run.results.pop()[1]
        for live, value in reversed(run.results):
            result = join(live, value, result)
        return result

    traced.__name__, traced.__doc__ = node.name, ast.get_docstring(node)
    return traced


def _expressions(statement: ast.stmt) -> Iterator[ast.expr]:
    """The expressions that `_Run` evaluates."""
    match statement:
        case ast.Return(value=ast.expr() as value) | ast.Assign(value=value):
            yield value
        case ast.If(test=test, body=body, orelse=orelse):
            yield test
            for inner in (*body, *orelse):
                yield from _expressions(inner)
        case ast.For(iter=iterated, body=body):
            yield iterated
            for inner in body:
                yield from _expressions(inner)


class _Run:
    """A call of a traced function.

    Every statement is evaluated once. `live` is the condition under which the function would get
    there: True, False, or unknown.
    """

    def __init__(self, known: ChainMap[str, Any], codes: dict[int, CodeType], join: Any) -> None:
        self.known, self.codes, self.join = known, codes, join
        self.results: list[tuple[Any, Any]] = []

    def block(self, statements: Sequence[ast.stmt], live: Any) -> Any:
        """Evaluate statements; returns the condition under which the end is reached."""
        for statement in statements:
            if live is False:
                break
            match statement:
                case ast.Return(value=ast.expr() as value):
                    self.results.append((live, self.value(value)))
                    return False
                case ast.Assign(targets=[target], value=value):
                    self.bind(target, self.value(value), live)
                case ast.If(test=test, body=body, orelse=orelse):
                    holds = self.value(test)
                    yes = self.block(body, _all(live, holds))
                    no = self.block(orelse, _all(live, _not(holds)))
                    live = _any(yes, no)
                case ast.For(target=target, iter=iterated, body=body):
                    for item in self.value(iterated):
                        self.bind(target, item, live)
                        live = self.block(body, live)
                case ast.Expr(value=ast.Constant()):  # a docstring
                    pass
                case _:
                    raise NotImplementedError(f"cannot trace {ast.unparse(statement)}")
        return live

    def value(self, node: ast.expr) -> Any:
        return eval(self.codes[id(node)], {}, self.known)

    def bind(self, target: ast.expr, value: Any, live: Any) -> None:
        if isinstance(target, ast.Tuple):
            for one, part in zip(target.elts, value, strict=True):
                self.bind(one, part, live)
            return
        name = ast.unparse(target)
        self.known[name] = self.join(live, value, self.known.maps[0].get(name, value))


class _Eager(ast.NodeTransformer):
    """Writes conditions as calls, all of whose arguments are evaluated."""

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        return self._call("_join", node.test, node.body, node.orelse)

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        return self._call("_all" if isinstance(node.op, ast.And) else "_any", *node.values)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        if isinstance(node.op, ast.Not):
            return self._call("_not", node.operand)
        return self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        if len(node.ops) == 1:
            return self.generic_visit(node)
        pairs = zip([node.left, *node.comparators], node.ops, node.comparators, strict=False)
        return self._call("_all", *(ast.Compare(left, [op], [right]) for left, op, right in pairs))

    def _call(self, name: str, *arguments: ast.expr) -> ast.Call:
        return ast.Call(ast.Name(name, ast.Load()), [self.visit(one) for one in arguments], [])


def _all(*conditions: Any) -> Any:
    unknown = [one for one in conditions if one is not True]
    if any(one is False for one in unknown):
        return False
    result: Any = True
    for one in unknown:
        result = one if result is True else result & one
    return result


def _any(*conditions: Any) -> Any:
    return _not(_all(*map(_not, conditions)))


def _not(condition: Any) -> Any:
    return not condition if isinstance(condition, bool) else ~condition
