"""Where episodes begin, compiled for many rows.

All of an episode's randomness comes from one key per row; see `rimless_gym.randomness`.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit
from numba.np.unsafe.ndarray import to_fixed_tuple

from rimless_gym.hybrid import DOUBLE
from rimless_gym.interval import COMMAND, COUNT, SLOPE, TIME, VOLTAGE, WEIGHT, observe_row
from rimless_gym.params import N_CONSTANTS, Constants
from rimless_gym.stepping import DPHI, DTHETA, FOOT, MODE, PHI, SOURCE_FINGERPRINT, THETA
from rimless_gym.task import draw_state, foot_force

DRAWN, GIVEN, HANGING = range(3)  # kinds of start; the last is at rest on two feet


@njit(error_model="numpy")
def _machine(constants, i):
    column = constants[:, i if constants.shape[1] > 1 else 0]
    return Constants(*to_fixed_tuple(column, N_CONSTANTS))


@njit(error_model="numpy")
def _start(kind, given, k, p, memory, streams, i):
    """Write the state in which row i starts; False if the ground would have to pull there."""
    if kind == DRAWN:
        found, mode, phi, theta, dphi, dtheta = draw_state(
            memory[SLOPE, i], memory[WEIGHT, i], p, streams, i
        )
    else:
        if kind == HANGING:
            mode, phi, theta, dphi, dtheta = DOUBLE, p.a, memory[SLOPE, i], 0.0, 0.0
        else:
            phi, theta, dphi, dtheta = given[k, 0], given[k, 1], given[k, 2], given[k, 3]
            mode = int(given[k, 4])
        found = foot_force(mode, phi, theta, dphi, dtheta, 0.0, p) > 0.0
    memory[PHI, i], memory[THETA, i], memory[DPHI, i] = phi, theta, dphi
    memory[DTHETA, i], memory[MODE, i], memory[FOOT, i] = dtheta, mode, 0.0
    return found


def _start_kernel(fingerprint: int) -> Callable[..., int]:
    @njit(error_model="numpy", cache=True)
    def start_rows(observations, rows, keys, kind, given, memory, streams, constants):
        fingerprint  # noqa: B018  in numba's cache key, as in `rimless_gym.stepping`
        failed = -1
        for k in range(len(rows)):
            i = rows[k]
            streams[i] = keys[k]
            p = _machine(constants, i)
            if not _start(kind, given, k, p, memory, streams, i) and failed < 0:
                failed = i
            memory[COMMAND, i] = memory[VOLTAGE, i] = memory[TIME, i] = memory[COUNT, i] = 0.0
            observe_row(memory, observations, i)
        return failed

    return start_rows


#: Compiled: (observations, rows, keys, kind, given, memory, streams, constants) -> the first row
#: that found no start, or -1. Starts the episodes of `rows`, each with the randomness of its key,
#: at a start of `kind`: drawn, or the states `given` (one per row: phi, theta, phi', theta', mode).
start_rows = _start_kernel(SOURCE_FINGERPRINT)


def _observe_kernel(fingerprint: int) -> Callable[..., None]:
    @njit(error_model="numpy", cache=True)
    def observe_rows(observations, memory):
        fingerprint  # noqa: B018  as above
        for i in range(memory.shape[1]):
            observe_row(memory, observations, i)

    return observe_rows


#: Compiled: (observations, memory): overwrites `observations` (float32, flat).
observe_rows = _observe_kernel(SOURCE_FINGERPRINT)
