"""A tile: the state of `LANES` wheels side by side, as numbers that vectorise.

A tile is one flat float64 array; quantity q of lane l is ``tile[q + l]``, with offsets q that
the compiler knows, so that a loop over lanes becomes a few vector instructions. Every lane does
the same arithmetic whatever the others hold: a wheel's motion does not depend on its neighbours.
Eight lanes fill the widest registers there are; more are no faster, and make a tile with one
wheel in it slower.
"""

from __future__ import annotations

import itertools

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from rimless_gym import energy as row
from rimless_gym.jit import inlined
from rimless_gym.params import N_CONSTANTS, Constants
from rimless_gym.trigonometry import cos, sin

LANES = 8
STAGES = 12  # of the integration step

_count = itertools.count()


def _rows(n: int) -> np.int64:
    first = next(_count)
    for _ in range(n - 1):
        next(_count)
    return np.int64(first * LANES)  # numba compiles what takes Python's integers once for each


# What a wheel brings along from step to step.
STATE = _rows(4)  # phi, theta, phi', theta'; the hybrid state goes on with
MODE = _rows(1)
FOOT = _rows(1)
ACC = _rows(2)  # phi'', theta''
VOLTAGE = _rows(1)
BOOKED = _rows(row.N_ROWS)  # of `rimless_gym.energy`, so far in this interval
ENERGY = _rows(1)  # mechanical, the foot's descent apart (J)
HUB = _rows(1)  # the hub's x from the stance foot (m)
ENERGY_BEFORE, HUB_BEFORE, FOOT_BEFORE = _rows(1), _rows(1), _rows(1)
LEFT = _rows(1)  # of the control interval (s)
EVENTS = _rows(1)
FAILURE = _rows(1)  # codes of `rimless_gym.hybrid`
INDEX = _rows(1)  # which of the caller's wheels it is

# The search for an event, over the attempts at one step.
ATTEMPT = _rows(1)  # length of the next attempt (s); negative: none yet
GOAL = _rows(1)  # event of `rimless_gym.kernel.events` that it should end on
LOW, HIGH = _rows(1), _rows(1)  # bracket of the event's time (s)
BEFORE, MISS_BEFORE = _rows(1), _rows(1)  # the attempt before, and its miss
TRIES = _rows(1)
CUT = _rows(1)  # what has cut the step so far

CARRIED = next(_count)  # all above is kept when a wheel waits for another step

CONSTANTS = _rows(N_CONSTANTS)
POLE = _rows(1)  # the motor's (1/s)

# Results of an attempt.
STEP = _rows(1)  # its length (s)
NEXT = _rows(4)  # state after it
STAGE_ACC = _rows(2 * STAGES)  # accelerations at the stages, times the step's length
NEXT_ACC = _rows(2)
SINES = _rows(4)  # sine and cosine of phi, then of theta, at its start
FAR = _rows(1)  # how far the angles turn from there to any stage, squared: phi's and theta's turns
TURNED = _rows(1)  # integral of psi'^2
BRAKED = _rows(1)  # integral of the air drag's power
FORCE_X, FORCE_Y, DEMAND, CLEARANCE = _rows(1), _rows(1), _rows(1), _rows(1)
NEXT_ENERGY, NEXT_HUB = _rows(1), _rows(1)
WORK_ELECTRICAL, WORK_POSITIVE, WORK_COPPER = _rows(1), _rows(1), _rows(1)
WORK_FRICTION, WORK_DRAG, WORK_SHAFT = _rows(1), _rows(1), _rows(1)
EVENT = _rows(1)  # on which an accepted step ended
FLAG = _rows(1)  # one of
PLAIN, CURRENT, SPLIT, FLAGGED, IDLE = 0.0, 1.0, 2.0, 3.0, 4.0
# nothing is to be done about the lane's attempt; its work is split where the current changes sign;
# where the current or psi' does; it is judged; the lane was done before and stays as it was.

TILE_SIZE = next(_count) * LANES


@inlined
def machine(tile, lane):
    """The lane's `Constants`."""
    c = CONSTANTS + lane
    return Constants(
        tile[c + 0 * LANES],
        tile[c + 1 * LANES],
        tile[c + 2 * LANES],
        tile[c + 3 * LANES],
        tile[c + 4 * LANES],
        tile[c + 5 * LANES],
        tile[c + 6 * LANES],
        tile[c + 7 * LANES],
        tile[c + 8 * LANES],
        tile[c + 9 * LANES],
        tile[c + 10 * LANES],
        tile[c + 11 * LANES],
        tile[c + 12 * LANES],
        tile[c + 13 * LANES],
        tile[c + 14 * LANES],
        tile[c + 15 * LANES],
        tile[c + 16 * LANES],
        tile[c + 17 * LANES],
        tile[c + 18 * LANES],
        tile[c + 19 * LANES],
        tile[c + 20 * LANES],
        tile[c + 21 * LANES],
        tile[c + 22 * LANES],
        tile[c + 23 * LANES],
        tile[c + 24 * LANES],
        tile[c + 25 * LANES],
    )


@inlined
def get_state(tile, quantity, lane):
    """Four numbers of a lane: a state."""
    i = quantity + lane
    return tile[i], tile[i + LANES], tile[i + 2 * LANES], tile[i + 3 * LANES]


@inlined
def put_state(tile, quantity, lane, y):
    """Set four numbers of a lane."""
    i = quantity + lane
    tile[i], tile[i + LANES], tile[i + 2 * LANES], tile[i + 3 * LANES] = y


@inlined
def get_pair(tile, quantity, lane):
    """Two numbers of a lane: accelerations."""
    return tile[quantity + lane], tile[quantity + LANES + lane]


@inlined
def put_pair(tile, quantity, lane, a):
    """Set two numbers of a lane."""
    tile[quantity + lane], tile[quantity + LANES + lane] = a


@inlined
def put_sines(tile, lane):
    """Set the sines and cosines of a lane's angles."""
    phi, theta, _, _ = get_state(tile, STATE, lane)
    put_state(tile, SINES, lane, (sin(phi), cos(phi), sin(theta), cos(theta)))


@inlined
def turned_angles(tile, lane, turn_phi, turn_theta):
    """phi and theta so far on from the attempt's start, for `rimless_gym.hybrid.turned`."""
    sin_phi, cos_phi, sin_theta, cos_theta = get_state(tile, SINES, lane)
    return (sin_phi, cos_phi, turn_phi), (sin_theta, cos_theta, turn_theta)


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
    """Called in a function: all its callers run the same instructions.

    Inlined here and there, sums of products would be fused differently, and differ in the last bit.
    """

    def codegen(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen
