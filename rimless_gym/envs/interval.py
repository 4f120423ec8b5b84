"""One control interval of many rows: the stepping kernel between a command and its reward.

Every array is field-major: a quantity's values over the rows lie side by side, so that these
loops and the kernel's run over several rows at once. A row's results are the same however many
rows there are and however they are divided among calls: the single environment is one row.
"""

from __future__ import annotations

import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from rimless_gym import energy as row
from rimless_gym.envs.task import OBSERVATION_SIZE, observation
from rimless_gym.hybrid import CONTACT_LOST, CONTROL_PERIOD, RATE_EXCEEDED
from rimless_gym.jit import ENVIRONMENT, inner, kept
from rimless_gym.kernel.stepping import (
    DPHI,
    DTHETA,
    MODE,
    PHI,
    SCRATCH_SIZE,
    STATE_SIZE,
    THETA,
    advance_batch,
)
from rimless_gym.params import N_CONSTANTS

# What is remembered of each row from step to step, `memory` (MEMORY_SIZE, N): the hybrid state
# (`rimless_gym.kernel.stepping`), where the episode is, and what task and machine ask for.
(
    VOLTAGE,  # held over the interval (V)
    COMMAND,  # last one given, voltage in units of the limit
    TIME,  # since the episode began (s)
    COUNT,  # intervals since then
    DELAY,  # intervals from command to voltage
    VOLTAGE_LIMIT,
    IDLE_POWER,
    FRICTION,
    WEIGHT,
    SLOPE,
    LEG_SCALE,  # of the observed leg angle
    VALUE_OF_DISTANCE,
    END_CHARGE,  # what an early end costs
    PUSH_WORK,  # of a push before the interval (J)
    PUSH_SHIFT,  # legs by which it moved the stance foot
    MEMORY_SIZE,
) = range(STATE_SIZE, STATE_SIZE + 16)

# What an interval gives, `block` (BLOCK_SIZE, N): the kernel's rows (`rimless_gym.energy`), then
IDLE, PUSH, REWARD_DISTANCE, REWARD_ENERGY, REWARD_END, REWARD, MARKS, BLOCK_SIZE = range(
    row.N_ROWS, row.N_ROWS + 8
)

# and, in the bytes of the row MARKS, what takes a byte: `marks(block)`, int8 (8, N).
TERMINATED, TRUNCATED, SLIPS, MODE_MARK, FAILURE_MARK, N_MARKS = 0, 1, 2, 3, 4, 8

#: What `info` calls the first rows of a block; "failure" is a code there.
INFO_NAMES = (
    *("elapsed", "distance", "electrical", "electrical_positive", "copper", "friction", "drag"),
    *("collision", "shaft", "mechanical_change", "steps", "touchdowns", "min_normal_force"),
    *("friction_demand", "impulse_friction_demand", "clearance", "force_x", "force_y", "failure"),
    *("touchdown_time", "idle", "push", "reward_distance", "reward_energy", "reward_end"),
)


def columns(n: int) -> int:
    """Columns of an array for n rows of an environment; those beyond n are never used.

    Rows of an array a large power of two apart would drive each other out of the cache.
    """
    return n if n <= 64 else 8 * (n // 8 + 2)


def marks(block: NDArray[np.float64]) -> NDArray[np.int8]:
    """The marks in a block, (N_MARKS, N); a view."""
    return block[MARKS].view(np.int8).reshape(N_MARKS, -1)


_marks = inner(marks)
_WIDTH = np.uint64(OBSERVATION_SIZE)


@inner
def _hold(memory, first, last):
    for i in range(first, last):
        memory[VOLTAGE, i] = memory[VOLTAGE_LIMIT, i] * min(max(memory[COMMAND, i], -1.0), 1.0)


@inner
def _pay(block, memory, first, last):
    for i in range(first, last):
        block[IDLE, i] = memory[IDLE_POWER, i] * block[row.TIME, i]
    for i in range(first, last):
        block[REWARD_DISTANCE, i] = memory[VALUE_OF_DISTANCE, i] * block[row.DISTANCE, i]
    for i in range(first, last):
        drawn = block[row.ELECTRICAL_POSITIVE, i] + block[IDLE, i]
        block[REWARD_ENERGY, i] = -drawn / memory[WEIGHT, i]
    for i in range(first, last):
        failure = block[row.FAILURE, i]
        ended = (failure == CONTACT_LOST) | (failure == RATE_EXCEEDED)
        block[REWARD_END, i] = -memory[END_CHARGE, i] if ended else 0.0
    for i in range(first, last):
        terms = block[REWARD_DISTANCE, i] + block[REWARD_ENERGY, i]
        block[REWARD, i] = terms + block[REWARD_END, i]


@inner
def _mark(block, memory, limit, first, last):
    """Write the marks; how many rows failed in any way or reached the limit."""
    bits, unusual = _marks(block), 0
    for i in range(first, last):
        memory[TIME, i] += block[row.TIME, i]
    for i in range(first, last):
        memory[COUNT, i] += 1.0
        bits[TRUNCATED, i] = memory[COUNT, i] >= limit
    for i in range(first, last):
        failure = block[row.FAILURE, i]
        bits[FAILURE_MARK, i] = int(failure)
        bits[TERMINATED, i] = (failure == CONTACT_LOST) | (failure == RATE_EXCEEDED)
    for i in range(first, last):
        demand = max(block[row.FRICTION_DEMAND, i], block[row.IMPULSE_FRICTION_DEMAND, i])
        bits[SLIPS, i] = demand > memory[FRICTION, i]
    for i in range(first, last):
        bits[MODE_MARK, i] = int(memory[MODE, i])
    for i in range(first, last):
        unusual += (bits[FAILURE_MARK, i] | bits[TRUNCATED, i]) != 0
    return unusual


@inner
def observe_row(memory, observations, i):
    """Write the observation of row i; `observations` is flat, OBSERVATION_SIZE numbers a row."""
    values = observation(
        memory[PHI, i],
        memory[THETA, i],
        memory[DPHI, i],
        memory[DTHETA, i],
        memory[MODE, i],
        memory[LEG_SCALE, i],
    )
    for k in range(OBSERVATION_SIZE):
        observations[i * _WIDTH + np.uint64(k)] = values[k]


# What a call of `step_rows` works on, `orders` (ORDERS_SIZE,): the addresses of its arrays, then
# the rows of memory and block, the machines (one for all, or one a row), and the part to step.
(
    BLOCK_AT,
    MEMORY_AT,
    CONSTANTS_AT,
    POLES_AT,
    WORK_AT,
    OBSERVATIONS_AT,
    COLUMNS,
    MACHINES,
    LIMIT,
    BEGIN,
    END,
    ORDERS_SIZE,
) = range(12)

#: A limit of intervals that no episode reaches.
NO_LIMIT = 2**62


@intrinsic
def _pointer(typing_context, address):
    """An address as a pointer."""

    def codegen(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), codegen


@kept(ENVIRONMENT, nogil=True)
def step_rows(address):
    """Hold `memory[COMMAND]` for one interval, in the rows of the orders at that address.

    It advances `memory`, and overwrites `block` (BLOCK_SIZE, COLUMNS) and the observations
    (float32, OBSERVATION_SIZE numbers a row). It returns how many of the rows failed in any way or
    reached LIMIT, the greatest COUNT.

    One row or many, it is one compiled function: two would be compiled apart and differ in the last
    bit; and unpacking arrays would take as long as a row's motion.
    """
    orders = carray(_pointer(address), ORDERS_SIZE, np.int64)
    wide, machines = orders[COLUMNS], orders[MACHINES]
    limit, begin, end = float(orders[LIMIT]), orders[BEGIN], orders[END]
    block = carray(_pointer(orders[BLOCK_AT]), (BLOCK_SIZE, wide), np.float64)
    memory = carray(_pointer(orders[MEMORY_AT]), (MEMORY_SIZE, wide), np.float64)
    constants = carray(_pointer(orders[CONSTANTS_AT]), (N_CONSTANTS, machines), np.float64)
    poles = carray(_pointer(orders[POLES_AT]), machines, np.float64)
    work = carray(_pointer(orders[WORK_AT]), SCRATCH_SIZE, np.float64)
    size = OBSERVATION_SIZE * end
    observations = carray(_pointer(orders[OBSERVATIONS_AT]), size, np.float32)
    first, last = np.uint64(begin), np.uint64(end)  # indices that cannot be negative
    _hold(memory, first, last)
    advance_batch(
        *(constants, poles, memory, memory[VOLTAGE], begin, end),
        *(CONTROL_PERIOD, 0.0, block, work),
    )
    _pay(block, memory, first, last)
    unusual = _mark(block, memory, limit, first, last)
    for i in range(first, last):
        block[PUSH, i] = 0.0
    for i in range(first, last):
        observe_row(memory, observations, i)
    return unusual


def orders_for(
    memory: NDArray[np.float64],
    constants: NDArray[np.float64],
    poles: NDArray[np.float64],
    work: NDArray[np.float64],
    limit: int,
    begin: int,
    end: int,
) -> NDArray[np.int64]:
    """Orders for `step_rows`, but for BLOCK_AT and OBSERVATIONS_AT.

    They hold while these arrays live.

    Args:
        memory: (MEMORY_SIZE, columns).
        constants: (N_CONSTANTS, 1) or (N_CONSTANTS, N), see `advance_batch`.
        poles: (1,) or (N,).
        work: `rimless_gym.kernel.stepping.scratch()`, one per thread.
        limit: `NO_LIMIT` for none.
        begin: first row.
        end: one after the last.
    """
    orders = np.zeros(ORDERS_SIZE, dtype=np.int64)
    orders[MEMORY_AT : WORK_AT + 1] = [a.ctypes.data for a in (memory, constants, poles, work)]
    orders[COLUMNS:] = memory.shape[1], constants.shape[1], limit, begin, end
    return orders


@kept()
def take_commands(actions, ignored, memory):
    """Copy the actions (N, 1) to `memory`, unless some are NaN that are not ignored: how many."""
    wrong = 0
    for i in range(len(actions)):
        wrong += (actions[i, 0] != actions[i, 0]) & (not ignored[i])
    if wrong == 0:
        for i in range(len(actions)):
            memory[COMMAND, i] = 0.0 if ignored[i] else actions[i, 0]
    return wrong
