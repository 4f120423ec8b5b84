"""A tile: the state of `LANES` wheels side by side, laid out for vector instructions.

A tile is one flat float64 array; quantity q of lane l is ``tile[q + l]``. The compiler knows the
offsets q, so a loop over lanes becomes a few vector instructions. Every lane does the same
arithmetic whatever the others hold: a wheel's motion does not depend on its neighbours.
Where a quantity is several numbers, they are `LANES` apart, and read and written together as a
named tuple.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from rimless_gym.energy import ROW
from rimless_gym.equations import Accelerations, Losses, State
from rimless_gym.jit import inlined, written
from rimless_gym.params import N_CONSTANTS, Constants
from rimless_gym.streams import Ground
from rimless_gym.trigonometry import cos, sin

#: Eight fill the widest registers there are. docs/benchmark.md has what they buy over one, and what
#: they cost where there is only one wheel.
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


STAGES = 12  # of the integration step

_count = itertools.count()


def _rows(n: int) -> np.int64:
    first = next(_count)
    for _ in range(n - 1):
        next(_count)
    return np.int64(first * LANES)  # with Python's integers, numba would compile once per value


# What a wheel keeps from step to step. STATE, MODE and FOOT are the hybrid state, and GROUND is
# next to them where a caller has one.
STATE = _rows(len(State._fields))
MODE = _rows(1)
FOOT = _rows(1)
GROUND = _rows(len(Ground._fields))
ACC = _rows(2)  # `Accelerations`
VOLTAGE = _rows(1)
TOTALS = _rows(len(ROW))  # of `rimless_gym.energy.ROW`, so far in this interval
ENERGY = _rows(1)  # mechanical, without the foot's descent (J)
HUB = _rows(1)  # the hub's x from the stance foot (m)
ENERGY_BEFORE, HUB_BEFORE, FOOT_BEFORE = _rows(1), _rows(1), _rows(1)
BEHIND, AHEAD = _rows(1), _rows(1)  # turns of the ground on both sides of the foot (rad)
FOOT_TRAVEL, FOOT_DESCENT = _rows(1), _rows(1)  # of the stance foot in this interval (m, J)
LEFT = _rows(1)  # of the control interval (s)
EVENTS = _rows(1)
FAILURE = _rows(1)  # codes of `rimless_gym.hybrid`
INDEX = _rows(1)  # which of the caller's wheels it is

# The search for an event, over the attempts at one step.
ATTEMPT = _rows(1)  # length of the next attempt (s); negative: none yet
GOAL = _rows(1)  # event of `rimless_gym.kernel.attempt` that it should end on
LOW, HIGH = _rows(1), _rows(1)  # bracket of the event's time (s)
BEFORE, MISS_BEFORE = _rows(1), _rows(1)  # the attempt before, and its miss
TRIES = _rows(1)
CUT = _rows(1)  # what has cut the step so far

CARRIED = next(_count)  # all above is kept when a wheel waits for another step

CONSTANTS = _rows(N_CONSTANTS)  # `Constants`
POLE = _rows(1)  # the motor's (1/s)

MACHINE_END = next(_count)  # up to here, a wheel and its machine

# Results of an attempt.
STEP = _rows(1)  # its length (s)
NEXT = _rows(4)  # state after it
STAGE_ACC = _rows(2 * STAGES)  # accelerations at the stages, times the step's length
NEXT_ACC = _rows(2)
SINES = _rows(4)  # sine and cosine of phi, then of theta, at its start
FAR = _rows(1)  # from there to any stage, the greatest sum of the squared turns of phi and theta
LOST = _rows(len(Losses._fields))  # integrals of the `Losses`
FORCE_X, FORCE_Y, DEMAND, CLEARANCE = _rows(1), _rows(1), _rows(1), _rows(1)
NEXT_ENERGY, NEXT_HUB = _rows(1), _rows(1)
FOOT_PULL = _rows(1)  # on two feet, the lift-off guard at its start or, once it is made, its end
WORK_ELECTRICAL, WORK_POSITIVE, WORK_SHAFT = _rows(1), _rows(1), _rows(1)
EVENT = _rows(1)  # on which an accepted step ended
FLAG = _rows(1)  # what is still to be done about the attempt, one of the following
PLAIN, CURRENT, SPLIT, FLAGGED, IDLE = 0.0, 1.0, 2.0, 3.0, 4.0
# PLAIN: nothing. CURRENT: split its work where the current changes sign. SPLIT: split it where the
# current or psi' does. FLAGGED: check it. IDLE: nothing, the lane was done before the attempt.

TILE_SIZE = next(_count) * LANES


# (tile, quantity, lane) -> a named tuple, and (tile, quantity, lane, values) -> None.
get_state, put_state = reader(State), writer(len(State._fields))
get_acc, put_acc = reader(Accelerations), writer(len(Accelerations._fields))
get_losses, put_losses = reader(Losses), writer(len(Losses._fields))
get_ground = reader(Ground)
_read_constants = reader(Constants)
_guards = {"a": "p.a + behind", "b": "p.b + ahead"}
_fields = ", ".join(_guards.get(name, f"p.{name}") for name in Constants._fields)
#: Compiled: a machine's `Constants` with the guards of ground that turns (rad) behind and ahead.
on_ground = inlined(
    written(f"def on_ground(p, behind, ahead):\n    return kind({_fields})", kind=Constants)
)


@inlined
def constants(tile, lane):
    """The lane's `Constants`, with the guards of the ground on which it stands."""
    p = _read_constants(tile, CONSTANTS, lane)
    return on_ground(p, tile[BEHIND + lane], tile[AHEAD + lane])


@inlined
def put_sines(tile, lane):
    """Set the sines and cosines of a lane's angles."""
    y = get_state(tile, STATE, lane)
    put_state(tile, SINES, lane, (sin(y.phi), cos(y.phi), sin(y.theta), cos(y.theta)))


@inlined
def turned_angles(tile, lane, turn_phi, turn_theta):
    """phi and theta after turns (rad) from the attempt's start, for `rimless_gym.hybrid.turned`."""
    sin_phi, cos_phi, sin_theta, cos_theta = get_state(tile, SINES, lane)
    return (sin_phi, cos_phi, turn_phi), (sin_theta, cos_theta, turn_theta)


@inlined
def unturned_angles(tile, lane):
    """phi and theta of STATE in the same form; this also sets SINES."""
    put_sines(tile, lane)
    return turned_angles(tile, lane, 0.0, 0.0)
