"""One step of many rows, called with a single number: the address of its orders.

Unpacking arrays in a call from Python would take as long as stepping a row.
"""

from __future__ import annotations

import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from rimless_gym.envs.control import Control
from rimless_gym.envs.interval import Course, step
from rimless_gym.envs.layout import BLOCK, MEMORY
from rimless_gym.equations import places, record
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import ENVIRONMENT, cached
from rimless_gym.kernel.stepping import SCRATCH_SIZE
from rimless_gym.params import N_CONSTANTS

#: Addresses of arrays; number of columns of memory and block; number of machines, 1 or one per
#: row; greatest number of intervals; length of an interval in units of 10 ms, whether an action is
#: a current, and the width of an observation; and the rows to step, the first and one after the
#: last.
Orders = record(
    "Orders",
    [
        *("block", "observations", "memory", "constants", "poles", "work"),
        *("columns", "machines", "limit", "ticks", "by_current", "width", "begin", "end"),
    ],
    __name__,
)
AT = places(Orders)

#: A limit of intervals that no episode reaches.
NO_LIMIT = 2**62


@intrinsic
def _pointer(typing_context, address):
    """An address as a pointer."""

    def codegen(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), codegen


@cached(ENVIRONMENT, nogil=True)
def step_rows(address):
    """`interval.step` with the orders at that address.

    The same compiled function steps one row or many: two functions, compiled separately, would
    differ in the last bit.
    """
    orders = carray(_pointer(address), len(AT), np.int64)
    wide, machines, end = orders[AT.columns], orders[AT.machines], orders[AT.end]
    block = carray(_pointer(orders[AT.block]), (len(BLOCK), wide), np.float64)
    memory = carray(_pointer(orders[AT.memory]), (len(MEMORY), wide), np.float64)
    constants = carray(_pointer(orders[AT.constants]), (N_CONSTANTS, machines), np.float64)
    poles = carray(_pointer(orders[AT.poles]), machines, np.float64)
    work = carray(_pointer(orders[AT.work]), SCRATCH_SIZE, np.float64)
    width, period = orders[AT.width], orders[AT.ticks] * CONTROL_PERIOD
    course = Course(float(orders[AT.limit]), period, orders[AT.by_current] != 0, width)
    observations = carray(_pointer(orders[AT.observations]), width * end, np.float32)
    begin = orders[AT.begin]
    return step(memory, constants, poles, course, begin, end, block, observations, work)


def orders_for(
    memory: NDArray[np.float64],
    constants: NDArray[np.float64],
    poles: NDArray[np.float64],
    work: NDArray[np.float64],
    limit: int,
    control: Control,
    rows: tuple[int, int],
) -> NDArray[np.int64]:
    """Orders for `step_rows`, in which the addresses of block and observations are still 0.

    They are valid as long as these arrays live.

    Args:
        memory: (len(MEMORY), columns).
        constants: (N_CONSTANTS, 1) or (N_CONSTANTS, N), see `advance_batch`.
        poles: (1,) or (N,).
        work: `rimless_gym.kernel.stepping.scratch()`, one per thread.
        limit: greatest number of intervals in an episode, or `NO_LIMIT`.
        control: how long an action is held, and what it commands.
        rows: the first, and one after the last.
    """
    addresses = [array.ctypes.data for array in (memory, constants, poles, work)]
    settings = limit, control.ticks, control.by_current, control.width
    sizes = memory.shape[1], constants.shape[1], *settings, *rows
    return np.array(Orders(0, 0, *addresses, *sizes), dtype=np.int64)


def give_results(
    orders: NDArray[np.int64], block: NDArray[np.float64], observations: NDArray[np.float32]
) -> None:
    """Make the orders write to these arrays: `block` (len(BLOCK), columns), flat observations."""
    orders[AT.block], orders[AT.observations] = block.ctypes.data, observations.ctypes.data
