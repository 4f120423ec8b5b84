"""Traced functions as JavaScript: what is needed twice is computed once."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from rimless_gym.javascript.tracing import Leaf, Symbol, Tree

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
