"""One control interval of many rows: the compiled function between actions and rewards.

It is called with a single number, the address of its arguments: unpacking arrays in a call from
Python would take as long as stepping a row. A row's results are the same however many rows there
are and however they are divided among calls: the single environment is one row.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from rimless_gym.envs.layout import (
    FLAG,
    FLAGS_SIZE,
    MEMORY,
    NO_ERRORS,
    RESULT,
    interval_of,
    observe_row,
    params_at,
    task_params_of,
    weights_of,
)
from rimless_gym.envs.task import TERM_NAMES, TERMS, rewarded
from rimless_gym.equations import places, record
from rimless_gym.hybrid import CONTROL_PERIOD, OK, motor_current, motor_voltage, relative_rate
from rimless_gym.jit import ENVIRONMENT, cached, inner, written
from rimless_gym.kernel.stepping import SCRATCH_SIZE, advance_batch_at
from rimless_gym.params import N_CONSTANTS
from rimless_gym.rules import exceeds

#: Addresses of arrays, and of the kernel; number of columns of memory and results; number of
#: machines, 1 or one per row; greatest number of intervals; length of an interval in units of
#: 10 ms, whether an action is a current, and the width of an observation; and the rows to step, the
#: first and one after the last. They are valid as long as the arrays live.
Arguments = record(
    "Arguments",
    [
        *("results", "observations", "memory", "constants", "poles", "work", "kernel"),
        *("columns", "machines", "limit", "ticks", "by_current", "width", "begin", "end"),
    ],
    __name__,
)
ARGUMENT = places(Arguments)

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
    """Hold the actions in a memory for one interval, with the `Arguments` at that address.

    It advances the memory, and overwrites results and observations (float32). It returns how many
    rows failed in any way or reached the limit. The same compiled function steps one row or many:
    two functions, compiled separately, would differ in the last bit.
    """
    a = carray(_pointer(address), len(ARGUMENT), np.int64)
    begin, end, width = a[ARGUMENT.begin], a[ARGUMENT.end], a[ARGUMENT.width]
    wide, machines = a[ARGUMENT.columns], a[ARGUMENT.machines]
    results = carray(_pointer(a[ARGUMENT.results]), (len(RESULT), wide), np.float64)
    flags = a[ARGUMENT.results] + RESULT.flags * wide * FLAGS_SIZE
    bits = carray(_pointer(flags), (FLAGS_SIZE, wide), np.int8)
    memory = carray(_pointer(a[ARGUMENT.memory]), (len(MEMORY), wide), np.float64)
    constants = carray(_pointer(a[ARGUMENT.constants]), (N_CONSTANTS, machines), np.float64)
    poles = carray(_pointer(a[ARGUMENT.poles]), machines, np.float64)
    work = carray(_pointer(a[ARGUMENT.work]), SCRATCH_SIZE, np.float64)
    observations = carray(_pointer(a[ARGUMENT.observations]), width * end, np.float32)
    first, last = np.uint64(begin), np.uint64(end)  # indices that cannot be negative
    if a[ARGUMENT.by_current] != 0:
        _drive(memory, constants, first, last)
    else:
        _hold(memory, first, last)
    duration = a[ARGUMENT.ticks] * CONTROL_PERIOD
    advance_batch_at(
        a[ARGUMENT.kernel],
        (
            *(constants, poles, memory, memory[MEMORY.voltage], begin, end),
            *(duration, 0.0, results, work),
        ),
    )
    _accumulate(results, memory, first, last)
    _use_allowance(results, memory, first, last)
    _reward(results, memory, first, last)
    unusual = _set_flags(results, bits, memory, float(a[ARGUMENT.limit]), first, last)
    for i in range(first, last):
        observe_row(memory, NO_ERRORS, observations, np.uint64(width), i)
    return unusual


@functools.cache
def compiled_step() -> Callable[[int], int]:
    """`step_rows`, called without numba's choice by types, which takes 3 % of a step's time."""
    step_rows.compile("int64(int64)")
    (compiled,) = step_rows.overloads.values()
    entry: Callable[[int], int] = compiled.entry_point
    return entry


@inner
def _hold(memory, first, last):
    """Set the voltages from the actions."""
    for i in range(first, last):
        share = min(max(memory[MEMORY.action, i], -1.0), 1.0)
        memory[MEMORY.voltage, i] = memory[MEMORY.voltage_limit, i] * share


@inner
def _drive(memory, constants, first, last):
    """Set the voltages to what drives the actions' currents now, as far as the limit allows."""
    for i in range(first, last):
        p, limit = params_at(constants, i), memory[MEMORY.voltage_limit, i]
        share = min(max(memory[MEMORY.action, i], -1.0), 1.0)
        current = share * motor_current(0.0, limit, p)
        dpsi = relative_rate(memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i], p)
        volts = motor_voltage(dpsi, current, p)
        memory[MEMORY.voltage, i] = min(max(volts, -limit), limit)


@inner
def _accumulate(results, memory, first, last):
    """Add what the kernel does not know: idle energy, and the work and steps of pushes."""
    for i in range(first, last):
        results[RESULT.idle, i] = memory[MEMORY.idle_power, i] * results[RESULT.elapsed, i]
        results[RESULT.push, i] = memory[MEMORY.push_work, i]
        results[RESULT.mechanical_change, i] += memory[MEMORY.push_work, i]
        results[RESULT.steps, i] += memory[MEMORY.push_shift, i]


_rewarded = inner(rewarded)


@inner
def _use_allowance(results, memory, first, last):
    """Reward travel as far as the allowance goes, and let the allowance grow."""
    for i in range(first, last):
        results[RESULT.rewarded_travel, i], memory[MEMORY.allowance, i] = _rewarded(
            *(results[RESULT.distance, i], results[RESULT.elapsed, i]),
            *(memory[MEMORY.allowance, i], memory[MEMORY.allowance_limit, i]),
            memory[MEMORY.target_speed, i],
        )


_reward = inner(
    written(
        "def add_rewards(results, memory, first, last):\n"
        "    for i in range(first, last):\n"
        "        row, total = interval_of(results, i), 0.0\n"
        "        params, weights = task_params_of(memory, i), weights_of(memory, i)\n"
        + "".join(
            f"        term = {term.__name__}(row, params, weights)\n"
            f"        results[{getattr(RESULT, name)}, i] = term\n"
            "        total += term\n"
            for name, term in zip(TERM_NAMES, TERMS, strict=True)
        )
        + f"        results[{RESULT.reward}, i] = total",
        **{term.__name__: inner(term) for term in TERMS},
        interval_of=interval_of,
        task_params_of=task_params_of,
        weights_of=weights_of,
    )
)


@inner
def _set_flags(results, bits, memory, limit, first, last):
    """Write the flags; returns how many rows failed in any way or reached the limit."""
    unusual = 0
    for i in range(first, last):
        memory[MEMORY.time, i] += results[RESULT.elapsed, i]
    for i in range(first, last):
        memory[MEMORY.count, i] += 1.0
        bits[FLAG.truncated, i] = memory[MEMORY.count, i] >= limit
    for i in range(first, last):
        failure = results[RESULT.failure, i]
        bits[FLAG.failure, i] = int(failure)
        bits[FLAG.terminated, i] = failure != OK
    for i in range(first, last):
        demand = max(results[RESULT.friction_demand, i], results[RESULT.impulse_friction_demand, i])
        bits[FLAG.slips, i] = exceeds(demand, memory[MEMORY.friction, i])
    for i in range(first, last):
        bits[FLAG.mode, i] = int(memory[MEMORY.mode, i])
    for i in range(first, last):
        unusual += (bits[FLAG.failure, i] | bits[FLAG.truncated, i]) != 0
    return unusual


@cached()
def take_actions(actions, ignored, memory):
    """Copy the actions (N, 1) to `memory`, unless some that count are NaN; returns how many."""
    wrong = 0
    for i in range(len(actions)):
        wrong += (actions[i, 0] != actions[i, 0]) & (not ignored[i])
    if wrong == 0:
        for i in range(len(actions)):
            memory[MEMORY.action, i] = 0.0 if ignored[i] else actions[i, 0]
    return wrong
