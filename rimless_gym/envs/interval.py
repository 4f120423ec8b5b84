"""One control interval of many rows: the stepping kernel between actions and rewards.

A row's results are the same however many rows there are and however they are divided among calls:
the single environment is one row.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rimless_gym.envs.layout import (
    BLOCK,
    MARK,
    MEMORY,
    ends_episode,
    interval_of,
    machine_of,
    marks,
    prices_of,
)
from rimless_gym.envs.observation import NO_ERRORS, observe_row
from rimless_gym.envs.perturbation import machine_at
from rimless_gym.envs.task import TERM_NAMES, TERMS, settled
from rimless_gym.hybrid import motor_current, motor_voltage, relative_rate
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import advance_batch
from rimless_gym.rules import exceeds

_marks, _settled = inner(marks), inner(settled)


class Course(NamedTuple):
    """What all intervals of a fleet have in common.

    Attributes:
        limit: greatest number of intervals in an episode.
        period: length of an interval (s).
        by_current: whether an action is the motor's current.
        width: of an observation.
    """

    limit: Any
    period: Any
    by_current: Any
    width: Any


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
        p, limit = machine_at(constants, i), memory[MEMORY.voltage_limit, i]
        share = min(max(memory[MEMORY.action, i], -1.0), 1.0)
        current = share * motor_current(0.0, limit, p)
        dpsi = relative_rate(memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i], p)
        volts = motor_voltage(dpsi, current, p)
        memory[MEMORY.voltage, i] = min(max(volts, -limit), limit)


@inner
def _account(block, memory, first, last):
    """Add what the environment books: idle energy, and the work and steps of pushes."""
    for i in range(first, last):
        block[BLOCK.idle, i] = memory[MEMORY.idle_power, i] * block[BLOCK.elapsed, i]
        block[BLOCK.push, i] = memory[MEMORY.push_work, i]
        block[BLOCK.mechanical_change, i] += memory[MEMORY.push_work, i]
        block[BLOCK.steps, i] += memory[MEMORY.push_shift, i]
        block[BLOCK.reward, i] = 0.0


@inner
def _settle(block, memory, first, last):
    """Pay for travel as far as the credit goes, and let the credit grow."""
    for i in range(first, last):
        block[BLOCK.paid, i], memory[MEMORY.credit, i] = _settled(
            *(block[BLOCK.distance, i], block[BLOCK.elapsed, i], memory[MEMORY.credit, i]),
            *(memory[MEMORY.credit_limit, i], memory[MEMORY.target_speed, i]),
        )


def _paying(name: str, term: Callable[..., Any]) -> Callable[..., None]:
    """Compiled: pay a term of the reward in all rows."""
    place, term = getattr(BLOCK, name), inner(term)

    def pay(block, memory, first, last):
        for i in range(first, last):
            machine, prices = machine_of(memory, i), prices_of(memory, i)
            block[place, i] = term(interval_of(block, i), machine, prices)
            block[BLOCK.reward, i] += block[place, i]

    pay.__qualname__ = f"pay_{name}"  # machine code finds functions by name
    return inner(pay)


def _in_turn(first_part: Callable[..., None], second_part: Callable[..., None]) -> Any:
    """Compiled: pay the first part, then the second."""

    def pay(block, memory, first, last):
        first_part(block, memory, first, last)
        second_part(block, memory, first, last)

    pay.__qualname__ = f"pay_{first_part.__qualname__}_{second_part.__qualname__}"
    return inner(pay)


_pay = functools.reduce(_in_turn, [_paying(*one) for one in zip(TERM_NAMES, TERMS, strict=True)])


@inner
def _mark(block, memory, limit, first, last):
    """Write the marks; returns how many rows failed in any way or reached the limit."""
    bits, unusual = _marks(block), 0
    for i in range(first, last):
        memory[MEMORY.time, i] += block[BLOCK.elapsed, i]
    for i in range(first, last):
        memory[MEMORY.count, i] += 1.0
        bits[MARK.truncated, i] = memory[MEMORY.count, i] >= limit
    for i in range(first, last):
        failure = block[BLOCK.failure, i]
        bits[MARK.failure, i] = int(failure)
        bits[MARK.terminated, i] = ends_episode(failure)
    for i in range(first, last):
        demand = max(block[BLOCK.friction_demand, i], block[BLOCK.impulse_friction_demand, i])
        bits[MARK.slips, i] = exceeds(demand, memory[MEMORY.friction, i])
    for i in range(first, last):
        bits[MARK.mode, i] = int(memory[MEMORY.mode, i])
    for i in range(first, last):
        unusual += (bits[MARK.failure, i] | bits[MARK.truncated, i]) != 0
    return unusual


@inner
def step(memory, constants, poles, course, begin, end, block, observations, work):
    """Hold the actions in `memory` for one interval, in rows `begin` to `end`.

    It advances `memory` (len(MEMORY), columns), and overwrites `block` (len(BLOCK), columns) and
    the flat `observations` (float32). It returns how many rows failed in any way or reached the
    limit of the `course`.
    """
    first, last = np.uint64(begin), np.uint64(end)  # indices that cannot be negative
    if course.by_current:
        _drive(memory, constants, first, last)
    else:
        _hold(memory, first, last)
    advance_batch(
        *(constants, poles, memory, memory[MEMORY.voltage], begin, end),
        *(course.period, 0.0, block, work),
    )
    _account(block, memory, first, last)
    _settle(block, memory, first, last)
    _pay(block, memory, first, last)
    unusual = _mark(block, memory, course.limit, first, last)
    width = np.uint64(course.width)
    for i in range(first, last):
        observe_row(memory, NO_ERRORS, observations, width, i)
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
