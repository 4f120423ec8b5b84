"""How numbers lie in a tile: `LANES` wheels side by side, each of their quantities `LANES` apart.

Eight lanes fill the widest registers there are. docs/benchmark.md has what they buy over one, and
what they cost where there is only one wheel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from rimless_gym.jit import inlined, written

LANES = 8


def reader(kind: type[Any]) -> Callable[..., Any]:
    """Compiled: (tile, quantity, lane) -> the lane's numbers from `quantity` on, as a `kind`."""
    numbers = ", ".join(f"tile[i + {k * LANES}]" for k in range(len(kind._fields)))
    return inlined(
        written(
            f"def get_{kind.__name__}(tile, quantity, lane):\n"
            "    i = quantity + lane\n"
            f"    return kind({numbers})",
            kind=kind,
        )
    )


def writer(count: int) -> Callable[..., Any]:
    """Compiled: (tile, quantity, lane, values) sets `count` numbers of the lane from `quantity` on.

    `values` is any tuple of as many numbers.
    """
    numbers = "".join(f"tile[i + {k * LANES}], " for k in range(count))
    return inlined(
        written(
            f"def put_{count}(tile, quantity, lane, values):\n"
            "    i = quantity + lane\n"
            f"    {numbers} = values"
        )
    )


def adder(count: int) -> Callable[..., Any]:
    """Compiled: (tile, quantity, lane, weight, values) adds weighted values to such numbers."""
    sums = "\n".join(f"    tile[i + {k * LANES}] += weight * values[{k}]" for k in range(count))
    return inlined(
        written(
            f"def add_{count}(tile, quantity, lane, weight, values):\n"
            "    i = quantity + lane\n"
            f"{sums}"
        )
    )


@intrinsic
def copy_lanes(typing_context, target, to, source, start):
    """Copy `LANES` consecutive numbers between flat arrays, in one or two instructions."""

    def codegen(context, builder, signature, arguments):
        data = [
            builder.gep(context.make_array(kind)(context, builder, array).data, [at])
            for kind, array, at in (
                (signature.args[0], *arguments[:2]),
                (signature.args[2], *arguments[2:]),
            )
        ]
        size = context.get_abi_sizeof(context.get_data_type(types.float64))
        cgutils.raw_memcpy(builder, *data, context.get_constant(types.intp, LANES), size)
        return context.get_dummy_value()

    return types.void(target, types.intp, source, types.intp), codegen


@intrinsic
def one_copy(typing_context):
    """Call this in a function to keep it from being inlined: all callers run the same instructions.

    Inlined copies would fuse sums of products differently, and differ in the last bit.
    """

    def codegen(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen
