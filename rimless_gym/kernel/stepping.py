"""The stepping kernel: advance hybrid states at constant voltage, events located, energy accounted.

Wheels are advanced `LANES` at a time, in a tile (`rimless_gym.kernel.tile`), by attempts at steps
that vectorise: integrate, measure, accept. A lane whose attempt ran into an event is handled by
itself and makes another attempt (`rimless_gym.kernel.attempt`). Wheels that need more than one step
gather in a second tile, which steps on whenever it is full. A wheel's motion is the same to the
last bit whatever moves beside it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import ArrayLike, NDArray

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD, MAX_RATE, drag_pole, friction_pole, motor_torque
from rimless_gym.jit import SIMULATOR, cached, inner
from rimless_gym.kernel import tile as slot
from rimless_gym.kernel.accounting import find_ground, open_interval
from rimless_gym.kernel.attempt import attempt_step, runs
from rimless_gym.kernel.integration import find_sines
from rimless_gym.kernel.tile import (
    CARRIED,
    LANES,
    MACHINE_END,
    TILE_SIZE,
    copy_lanes,
    get_ground,
    one_copy,
)
from rimless_gym.params import N_CONSTANTS, WheelParams
from rimless_gym.streams import Ground


class HybridState(NamedTuple):
    """The hybrid state: angles (rad), rates (rad/s), stance mode, and the stance foot.

    The foot counts legs forward of the first one.
    """

    phi: Any
    theta: Any
    dphi: Any
    dtheta: Any
    mode: Any
    foot: Any


# The indices of its fields in an array.
STATE_SIZE = len(HybridState._fields)
PHI, THETA, DPHI, DTHETA, MODE, FOOT = HybridState(*range(STATE_SIZE))
GROUNDED_SIZE = STATE_SIZE + len(Ground._fields)  # of a state with its ground

SCRATCH_SIZE = 2 * TILE_SIZE + 1

#: Fastest motor pole (1/s). At this pole 10 ms take 700 steps, a millisecond of computing.
MAX_POLE = 1e4


def hybrid_states(x: ArrayLike, mode: ArrayLike) -> NDArray[np.float64]:
    """Hybrid states (N, STATE_SIZE) on their first foot: x (N, 4), in modes (N,) or one for all."""
    states = np.zeros((len(np.asarray(x)), STATE_SIZE))
    states[:, :MODE], states[:, MODE] = x, mode
    return states


@inner
def share_machine(work, constants, poles):
    """Put one machine into all lanes of both tiles, unless it is there since the last call."""
    same = work[-1] == 1.0 and work[slot.POLE] == poles[0]
    for c in range(N_CONSTANTS):
        same = same and work[slot.CONSTANTS + c * LANES] == constants[c, 0]
    if not same:
        for lane in range(LANES):
            load_machine(work, lane, constants, poles, 0)
            load_machine(work, TILE_SIZE + lane, constants, poles, 0)
    work[-1] = 1.0


@inner
def load_machine(tile, lane, constants, poles, i):
    """Put the caller's machine i into a lane."""
    for c in range(N_CONSTANTS):
        tile[slot.CONSTANTS + c * LANES + lane] = constants[c, i]
    tile[slot.POLE + lane] = poles[i]


@inner
def load(tile, states, voltages, base, count, stride):
    """Put wheels base, base + 1, ... into the tile's lanes; `states` has flat rows of `stride`."""
    for lane in range(LANES):
        tile[slot.INDEX + lane] = base + lane
        tile[slot.BEHIND + lane] = tile[slot.AHEAD + lane] = 0.0
        for c in range(STATE_SIZE, GROUNDED_SIZE):
            tile[slot.STATE + c * LANES + lane] = 0.0
    size = GROUNDED_SIZE if len(states) >= GROUNDED_SIZE * stride else STATE_SIZE
    if count == LANES:
        for c in range(size):
            copy_lanes(tile, slot.STATE + c * LANES, states, c * stride + base)
        copy_lanes(tile, slot.VOLTAGE, voltages, base)
        return
    for lane in range(count):
        for c in range(size):
            tile[slot.STATE + c * LANES + lane] = states[c * stride + base + lane]
        tile[slot.VOLTAGE + lane] = voltages[base + lane]


@inner
def store(tile, states, out, base, count, stride):
    """Write wheels base, base + 1, ... back from the tile's lanes."""
    if count < LANES:
        for lane in range(count):
            store_lane(tile, lane, states, out, stride)
        return
    for c in range(STATE_SIZE):
        copy_lanes(states, c * stride + base, tile, slot.STATE + c * LANES)
    for c in range(len(ROW)):
        copy_lanes(out, c * stride + base, tile, slot.TOTALS + c * LANES)


@inner
def store_lane(tile, lane, states, out, stride):
    """Write one wheel back."""
    i = int(tile[slot.INDEX + lane])
    for c in range(STATE_SIZE):
        states[c * stride + i] = tile[slot.STATE + c * LANES + lane]
    for c in range(len(ROW)):
        out[c * stride + i] = tile[slot.TOTALS + c * LANES + lane]


@inner
def gather(tile, count, other, many):
    """Move lanes that need another step to free lanes of another tile; returns how many are left.

    `many` is whether machines differ.
    """
    left, free = 0, 0
    for lane in range(count):
        if runs(tile, lane):
            while free < LANES and runs(other, free):
                free += 1
            if free == LANES:
                left += 1
                continue
            for quantity in range(MACHINE_END if many else CARRIED):
                other[quantity * LANES + free] = tile[quantity * LANES + lane]
            tile[slot.LEFT + lane] = 0.0
    return left


@inner
def running(tile):
    """Which lanes need another step, as bits."""
    bits = 0
    for lane in range(LANES):
        bits |= int(runs(tile, lane)) << lane
    return bits


@inner
def store_lanes(tile, bits, states, out, stride):
    """Write the wheels of some lanes back."""
    for lane in range(LANES):
        if bits >> lane & 1:
            store_lane(tile, lane, states, out, stride)


@cached(SIMULATOR, nogil=True)
def advance_batch(constants, poles, states, voltages, first, last, duration, pull, out, work):
    """Advance the hybrid states in columns `first` to `last` of `states`, at `voltages`.

    A hybrid state is the first STATE_SIZE rows of a column; if there are more rows, the next ones
    are its `Ground`. All wheels have the same machine, with `constants` (N_CONSTANTS, 1) and
    `poles` (1,), or each has its own, with (N_CONSTANTS, N) and (N,). The first len(ROW) rows of
    `out` are overwritten (`rimless_gym.energy.ROW`); it has as many columns as `states`. `pull` is
    the largest force (N) with which the ground holds a foot down: 0, or infinity for a pin joint.
    `work` is `scratch()`, one per thread.
    """
    one_copy()
    flat, flat_out, stride = states.ravel(), out.ravel(), states.shape[1]
    tile, spare = work[:TILE_SIZE], work[TILE_SIZE : 2 * TILE_SIZE]
    many = constants.shape[1] > 1
    for lane in range(LANES):
        spare[slot.LEFT + lane] = 0.0
    if not many:
        share_machine(work, constants, poles)
    else:
        work[-1] = 0.0
    few, waiting = last - first <= LANES, False
    for base in range(first, last, LANES):
        count = min(LANES, last - base)
        load(tile, flat, voltages, base, count, stride)
        if many:
            for lane in range(count):
                load_machine(tile, lane, constants, poles, base + lane)
        for lane in range(count):
            if get_ground(tile, slot.GROUND, lane).slope_std > 0.0:
                find_ground(tile, lane)
        open_interval(tile, duration, pull)
        unfinished = attempt_step(tile, count, duration, pull)
        while unfinished and few:
            find_sines(tile)
            unfinished = attempt_step(tile, count, duration, pull)
        store(tile, flat, flat_out, base, count, stride)
        if unfinished:
            unfinished, waiting = gather(tile, count, spare, many), True
        while unfinished or (waiting and base + LANES >= last):
            ran = running(spare)
            find_sines(spare)
            waiting = attempt_step(spare, np.int64(LANES), duration, pull) > 0
            store_lanes(spare, ran & ~running(spare), flat, flat_out, stride)
            if unfinished:
                unfinished, waiting = gather(tile, count, spare, many), True


@functools.cache
def kernel_address() -> int:
    """Where the machine code of `advance_batch` is in this process."""
    arrays = "float64[:, ::1], float64[::1]"
    advance_batch.compile(f"({arrays}, {arrays}, int64, int64, float64, float64, {arrays})")
    (compiled,) = advance_batch.overloads.values()
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return address


@intrinsic
def advance_batch_at(typing_context: Any, address: Any, arguments: Any) -> Any:
    """Call `advance_batch` at its address. Where it is called by name, it is compiled in again."""

    def codegen(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        kinds, convention = tuple(signature.args[1]), context.call_conv
        function = convention.get_function_type(types.none, kinds).as_pointer()
        kernel = builder.inttoptr(given[0], function)
        values = cgutils.unpack_tuple(builder, given[1])
        convention.call_function(builder, kernel, types.none, kinds, values)
        return context.get_dummy_value()

    return types.none(types.int64, arguments), codegen


@functools.lru_cache(maxsize=256)  # asked at every call of `advance`
def require_steppable(params: WheelParams) -> None:
    """Refuse machines that need too many steps in a control interval."""
    if not params.motor_pole <= MAX_POLE:
        raise ValueError(
            f"the motor damps psi' at {params.motor_pole:.3g}/s, faster than the {MAX_POLE:.3g}/s "
            "that stepping allows: raise the inertias or armature_resistance, or lower "
            "motor_constant, gear_ratio or hub_damping"
        )
    c = params.constants
    pole = friction_pole(0.0, motor_torque(0.0, params.voltage_limit, c), c)
    if not pole <= MAX_POLE:
        raise ValueError(
            f"friction_width = {params.friction_width:.3g} rad/s: dry friction damps psi' at "
            f"{pole:.3g}/s there, faster than the {MAX_POLE:.3g}/s that stepping allows: raise it, "
            "or lower hub_friction, gear_loss or voltage_limit"
        )
    pole = drag_pole(MAX_RATE, MAX_RATE, c)
    if not pole <= MAX_POLE:
        raise ValueError(
            f"drag = {params.drag:.3g} and pendulum_drag = {params.pendulum_drag:.3g} damp rates "
            f"of {MAX_RATE} rad/s at {pole:.3g}/s, faster than the {MAX_POLE:.3g}/s that stepping "
            "allows: lower them, or raise the inertias"
        )


def machine_arrays(
    machines: Sequence[WheelParams],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the kernel needs of the machines: constants (N_CONSTANTS, N) and motor poles (N,)."""
    for params in machines:
        require_steppable(params)
    constants = np.stack([params.constants_array for params in machines], axis=1)
    return np.ascontiguousarray(constants), np.array([params.motor_pole for params in machines])


def scratch() -> NDArray[np.float64]:
    """Work space for one call of the kernel at a time."""
    space = aligned((SCRATCH_SIZE,))
    space[:] = 0.0
    return space


def aligned(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An empty array that starts on a cache line, as do its rows of a tile's width.

    Reading eight numbers at once takes twice as long across two cache lines.
    """
    size = math.prod(shape)
    space = np.empty(size + LANES)
    begin = -(space.ctypes.data // space.itemsize) % LANES
    return space[begin : begin + size].reshape(shape)


def advance(
    params: WheelParams,
    states: NDArray[np.float64],
    voltages: NDArray[np.float64],
    duration: float = CONTROL_PERIOD,
    pull: float = 0.0,
) -> NDArray[np.float64]:
    """Advance N hybrid states, each at its own constant voltage.

    Args:
        params: the machine.
        states: (N, STATE_SIZE), or (N, GROUNDED_SIZE) on rough ground, advanced in place.
        voltages: (N,) in V.
        duration: time to advance (s).
        pull: largest force (N) with which the ground holds a foot down.

    Returns:
        Rows of `rimless_gym.energy.ROW` per state, (N, len(ROW)).
    """
    columns, out = np.ascontiguousarray(states.T), np.empty((len(ROW), len(states)))
    volts = np.ascontiguousarray(voltages, dtype=np.float64)
    advance_batch(
        *(*machine_arrays([params]), columns, volts, 0, len(volts)),
        *(float(duration), float(pull), out, scratch()),
    )
    states[:] = columns.T
    return np.ascontiguousarray(out.T)
