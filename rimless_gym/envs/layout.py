"""The layout of a fleet's arrays: where everything is, by name.

Every array is field-major, (fields, rows): a quantity's values over the rows lie side by side, so
that loops over rows vectorise. ``memory[MEMORY.voltage, i]`` is one number; the `*_of` functions
read several of them as a named tuple.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.energy import Row
from rimless_gym.envs.task import TERM_NAMES, Task
from rimless_gym.equations import places, record
from rimless_gym.hybrid import CONTACT_LOST, RATE_EXCEEDED
from rimless_gym.jit import inner, written
from rimless_gym.kernel.stepping import HybridState
from rimless_gym.params import Constants


class Machine(NamedTuple):
    """What the task needs to know about the machine.

    Attributes:
        voltage_limit: V.
        idle_power: W.
        friction: friction coefficient of the ground.
        weight: N.
        slope: rad.
        leg_scale: scale of the observed leg angle, 2 / alpha (1/rad).
        credit_limit: most travel that may be paid at once, a step length (m); see `Task`.
    """

    voltage_limit: Any
    idle_power: Any
    friction: Any
    weight: Any
    slope: Any
    leg_scale: Any
    credit_limit: Any


Prices = record(  # the fields of a Task
    "Prices",
    [field.name for field in dataclasses.fields(Task)],
    __name__,
)

#: What is remembered of each row from step to step: the hybrid state; the voltage held over the
#: interval (V) and the last action; time (s) and intervals since the episode began; the delay from
#: action to voltage (intervals); machine and prices; the travel that may still be paid (m); and,
#: for a push before the interval, its work (J) and the number of legs by which it moved the stance
#: foot.
Memory = record(
    "Memory",
    [
        *HybridState._fields,
        *("voltage", "action", "time", "count", "delay"),
        *Machine._fields,
        *Prices._fields,
        *("credit", "push_work", "push_shift"),
    ],
    __name__,
)
MEMORY = places(Memory)

#: The rows of the prices in a memory.
PRICES = slice(MEMORY.distance_weight, MEMORY.distance_weight + len(Prices._fields))

#: The results of an interval: the kernel's rows, the energies that the environment adds, the travel
#: that is paid, the rewards, and a last row whose bytes are laid out by `MARK`.
Block = record(
    "Block", [*Row._fields, "idle", "push", "paid", *TERM_NAMES, "reward", "marks"], __name__
)
BLOCK = places(Block)


class Mark(NamedTuple):
    """Truth values and codes of one byte each, in the 8 bytes of a number; see `marks`."""

    terminated: Any
    truncated: Any
    slips: Any
    mode: Any
    failure: Any


MARK = Mark(*range(len(Mark._fields)))

#: Names in `info` of the first rows of a block, its numbers. There "failure" is an integer code.
INFO_NAMES = Block._fields[: BLOCK.reward]


#: An interval as the terms of the reward see it: `failed` is 1 where the episode ended early.
Interval = record("Interval", [*Row._fields, "idle", "push", "paid", "failed"], __name__)


def columns(n: int) -> int:
    """Number of columns of an array for n rows of an environment; those beyond n are unused.

    Without them, rows of an array could be a large power of two apart and evict each other from
    the cache.
    """
    return n if n <= 64 else 8 * (n // 8 + 2)


def marks(block: NDArray[np.float64]) -> NDArray[np.int8]:
    """The marks in a block, (8, N); a view."""
    return block[BLOCK.marks].view(np.int8).reshape(8, -1)


def reader(kind: type[Any], first: int) -> Any:
    """Compiled: (array, i) -> the numbers of column i from row `first` on, as a named tuple."""
    numbers = ", ".join(f"array[{first + k}, i]" for k in range(len(kind._fields)))
    return inner(
        written(f"def {kind.__name__}_of(array, i):\n    return kind({numbers})", kind=kind)
    )


def writer(kind: type[Any], first: int) -> Any:
    """Compiled: (array, i, values) sets the numbers that the matching `reader` reads."""
    numbers = "".join(f"array[{first + k}, i], " for k in range(len(kind._fields)))
    return inner(written(f"def set_{kind.__name__}(array, i, values):\n    {numbers} = values"))


constants_of = reader(Constants, 0)  # of (N_CONSTANTS, N)
machine_of = reader(Machine, getattr(MEMORY, Machine._fields[0]))
prices_of = reader(Prices, PRICES.start)
set_machine = writer(Machine, getattr(MEMORY, Machine._fields[0]))


@inner
def ends_episode(failure):
    """Whether a failure ends the episode; any other failure is an error."""
    return (failure == CONTACT_LOST) | (failure == RATE_EXCEEDED)


_numbers = ", ".join(f"block[{k}, i]" for k in range(len(Interval._fields) - 1))
#: Compiled: (block, i) -> the `Interval` of row i.
interval_of = inner(
    written(
        f"def interval_of(block, i):\n"
        f"    failed = 1.0 if ends_episode(block[{BLOCK.failure}, i]) else 0.0\n"
        f"    return Interval({_numbers}, failed)",
        Interval=Interval,
        ends_episode=ends_episode,
    )
)
