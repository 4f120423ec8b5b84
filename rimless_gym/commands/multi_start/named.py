"""The problem that a name, module:function, stands for."""

from __future__ import annotations

import importlib

from trajopt.ocp.problem import Problem


def problem_named(name: str) -> Problem:
    """What the function of that name returns, or the object of that name.

    Args:
        name: module:function.

    Raises:
        ValueError: it cannot be imported, or does not give a problem.
    """
    module, _, function = name.partition(":")
    try:
        make = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"{name!r}: no such module:function can be imported ({error})") from error
    problem = make() if callable(make) else make
    if not isinstance(problem, Problem):
        raise ValueError(f"{name!r}: gives {type(problem).__name__}, not a trajopt.Problem")
    return problem
