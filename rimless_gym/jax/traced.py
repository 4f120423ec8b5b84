"""The simulator's functions, of JAX's arrays: traced from the lines that numba compiles."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp

from rimless_gym import equations, hybrid
from rimless_gym.kernel import accounting, attempt, integration
from rimless_gym.tracing import joined, names_within

ROOT_STEPS = 7  # of Newton's method for the root of a polynomial; later attempts correct the rest


def safe_sqrt(x: Any) -> Any:
    """Square root whose derivative at 0 is 0."""
    return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1)), 0)


def root(c: Any, low: Any, high: Any) -> Any:
    """`integration.bracketed_root` in a fixed number of steps."""

    def step(_: Any, bracket: Any) -> Any:
        low, high, s = bracket
        f = traced.value(c, s)
        low, high = jnp.where(f > 0, low, s), jnp.where(f > 0, s, high)
        newton = s - f / traced.slope(c, s)
        return low, high, jnp.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))

    low, high = (x + jnp.zeros_like(c[0] + c[5]) for x in (low, high))
    return jax.lax.fori_loop(0, ROOT_STEPS, step, (low, high, 0.5 * (low + high)))[2]


def _folded(of_arrays: Callable[..., Any], of_numbers: Callable[..., Any]) -> Callable[..., Any]:
    """The function of arrays, but of Python's numbers where all arguments are."""

    def fold(*values: Any) -> Any:
        known = all(isinstance(value, (int, float)) for value in values)
        return (of_numbers if known else of_arrays)(*values)

    return fold


_sin, _cos = _folded(jnp.sin, math.sin), _folded(jnp.cos, math.cos)
_sqrt = _folded(safe_sqrt, math.sqrt)

#: What names in the traced functions stand for.
OF_ARRAYS: dict[str, Any] = {
    "sin": _sin,
    "cos": _cos,
    "sqrt": _sqrt,
    "min": _folded(lambda *values: functools.reduce(jnp.minimum, values), min),
    "max": _folded(lambda *values: functools.reduce(jnp.maximum, values), max),
    "float": lambda x: x,
    "math": SimpleNamespace(
        pi=math.pi, inf=math.inf, sin=_sin, hypot=_folded(jnp.hypot, math.hypot)
    ),
    "np": SimpleNamespace(pi=math.pi, sqrt=_sqrt, maximum=jnp.maximum),
}

#: The functions of the simulator, of JAX's arrays.
traced = joined(
    {
        equations: names_within(equations.equations),
        hybrid: (
            *("accelerations", "foot_force", "both_feet_press", "rocks_too_fast"),
            *("after_touchdown", "after_lift_off"),
        ),
        integration: ("quintic", "value", "slope", "derivative", "negative", "upward_root"),
        attempt: (
            *("peak", "friction_rate", "windage_rate"),
            *("past_guard", "between", "reversal"),
        ),
        accounting: ("_crossings", "_passed", "_zero"),
    },
    jnp.where,
    **OF_ARRAYS,
    bracketed_root=root,
)
