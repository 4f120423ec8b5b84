"""The stepping kernel: advance the hybrid state at constant voltage, events located, energy booked.

A touchdown inside an 8th-order step is located on the quintic through the step's ends, stepped to,
and corrected until the leg is on its guard; loss of contact and lift-off likewise, on the forces.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from rimless_gym import energy as row
from rimless_gym.booking import book_extremes, book_motion, book_touchdown
from rimless_gym.events import (
    BACKWARD,
    FORWARD,
    LIFT_OFF,
    NOTHING,
    RELEASE,
    between,
    force_guard,
    reversal,
    step_to_force_event,
    step_to_touchdown,
    touchdown_crossing,
    turning_cut,
)
from rimless_gym.hybrid import (
    CONTACT_LOST,
    CONTROL_PERIOD,
    DIVERGED,
    DOUBLE,
    MAX_EVENTS,
    MAX_RATE,
    OK,
    RATE_EXCEEDED,
    SINGLE,
    THESIS_BACKWARD,
    TOO_MANY_EVENTS,
    accelerations,
    after_lift_off,
    after_touchdown,
    hub_position,
    mechanical_energy,
)
from rimless_gym.integration import STAGES, rk8
from rimless_gym.params import N_CONSTANTS, Constants, WheelParams

# Layout of the hybrid state vector; FOOT counts legs from the first stance foot.
PHI, THETA, DPHI, DTHETA, MODE, FOOT, STATE_SIZE = range(7)

#: Steps are so short that pole * h and turning * h stay below these (see `step_length`): energy
#: balances to 1e-9 relative over an interval at any rate, and to 1e-11 on a gait.
MAX_POLE_STEP, MAX_RATE_STEP = 0.15, 0.175

#: Fastest motor pole (1/s): 10 ms then take 700 steps, a millisecond.
MAX_POLE = 1e4


@njit(error_model="numpy")
def step_length(left, y, acc, pole, p):
    """The longest equal division of the time left that the poles and the rates allow.

    Rates are those of the angles in the equations, phi + theta the fastest, with what half of the
    time left adds to them; air drag has a pole of its own.
    """
    turning = abs(y[2]) + abs(y[3]) + 0.5 * left * (abs(acc[0]) + abs(acc[1]))
    braking = 2 * p.drag * p.L1**3 * abs(y[2]) / (p.Je1 - p.Je3**2 / (p.Je2 + p.Jr))
    fastest = max((pole + braking) / MAX_POLE_STEP, turning / MAX_RATE_STEP, 1e-9)
    return left / np.ceil(left * fastest)


@njit(error_model="numpy")
def smooth_step(mode, y, acc, u, h, pull, p, k):
    """One step, cut short at the first event in it.

    Returns (h, state, accelerations, rk8's two integrals, the event of `rimless_gym.events`).
    """
    after, q, d = rk8(mode, y, acc, u, h, p, k)
    acc_after = accelerations(mode, after[0], after[1], after[2], after[3], u, p)
    if p.drag > 0.0 and y[2] * after[2] < 0.0:  # |phi'| phi' has a kink at 0: end the step on it
        h *= reversal(y, acc, after, acc_after, h)
        after, q, d = rk8(mode, y, acc, u, h, p, k)
        acc_after = accelerations(mode, after[0], after[1], after[2], after[3], u, p)
    event = NOTHING
    if mode == SINGLE:
        cut = turning_cut(y, acc, after, acc_after, h, p)
        if cut < 1.0:
            h *= cut
            after, q, d = rk8(mode, y, acc, u, h, p, k)
            acc_after = accelerations(mode, after[0], after[1], after[2], after[3], u, p)
        event, s, s_past = touchdown_crossing(y, acc, after, acc_after, h, p)
        if event != NOTHING:
            h, after, q, d = step_to_touchdown(event, s, s_past, mode, y, acc, u, h, p, k)
    elif force_guard(LIFT_OFF, mode, after, u, pull, p) > 0.0:
        event = LIFT_OFF
        h, after, q, d = step_to_force_event(event, mode, y, acc, after, h, u, pull, p, k)
    if event != NOTHING:
        acc_after = accelerations(mode, after[0], after[1], after[2], after[3], u, p)
    if h == 0.0:
        return h, after, acc_after, q, d, event
    for s in (0.5, 1.0):
        end = between(y, acc, after, acc_after, h, s) if s < 1.0 else after
        if force_guard(RELEASE, mode, end, u, pull, p) > 0.0:
            h, after, q, d = step_to_force_event(RELEASE, mode, y, acc, end, s * h, u, pull, p, k)
            acc_after = accelerations(mode, after[0], after[1], after[2], after[3], u, p)
            return h, after, acc_after, q, d, RELEASE
    return h, after, acc_after, q, d, event


def _kernel(fingerprint: int) -> Callable[..., int]:
    @njit(error_model="numpy", cache=True)
    def advance_kernel(constants, pole, x, u, duration, pull, out, k):
        fingerprint  # noqa: B018  in numba's cache key, so that no stale machine code is loaded
        p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
        mode, foot = int(x[MODE]), int(x[FOOT])
        y = (x[PHI], x[THETA], x[DPHI], x[DTHETA])
        chord = 2 * p.L1 * np.sin(p.alpha / 2)
        descent = (p.m1 + p.m2) * p.g * chord * np.sin(p.gamma)
        hub_before = hub_position(y[0], p)[0] + foot * chord
        energy_before = mechanical_energy(y[0], y[1], y[2], y[3], p) - foot * descent
        foot_before = foot
        out[:] = 0.0
        out[row.MIN_NORMAL_FORCE] = np.inf
        out[row.CLEARANCE] = np.inf
        acc = accelerations(mode, y[0], y[1], y[2], y[3], u, p)
        book_extremes(y, acc, p, out)
        failure, event, events, t = OK, NOTHING, 0, 0.0
        if force_guard(RELEASE, mode, y, u, pull, p) > 0.0:
            failure = CONTACT_LOST
        while failure == OK and t < duration:
            if event == LIFT_OFF or (
                mode == DOUBLE and force_guard(LIFT_OFF, mode, y, u, pull, p) > 0.0
            ):
                phi, shift = after_lift_off(y[1], y[3], u, p)
                mode, foot, y = SINGLE, foot + shift, (phi, y[1], 0.0, y[3])
                acc = accelerations(mode, y[0], y[1], y[2], y[3], u, p)
                events += 1
            fastest = max(abs(y[2]), abs(y[3]))
            if not fastest <= MAX_RATE:
                failure = RATE_EXCEEDED if fastest > MAX_RATE else DIVERGED
                break
            left = duration - t
            h, after, acc_after, q, d, event = smooth_step(
                mode, y, acc, u, step_length(left, y, acc, pole, p), pull, p, k
            )
            if not max(abs(after[2]), abs(after[3])) < 10 * MAX_RATE:
                failure = DIVERGED  # beyond what a step can be trusted with
                break
            if h > 0.0:
                book_motion(y, acc, after, acc_after, h, u, q, d, p, out)
            t = duration if h == left else t + h
            y, acc = after, acc_after
            book_extremes(y, acc, p, out)
            if event == RELEASE:
                failure = CONTACT_LOST
            elif event in (FORWARD, BACKWARD):
                mode, phi, dtheta, dphi, shift, legal = after_touchdown(
                    event, y[1], y[2], y[3], u, p
                )
                if not legal:
                    failure = THESIS_BACKWARD
                    break
                after = (phi, y[1], dphi, dtheta)
                book_touchdown(y, after, shift, descent, p, out)
                y, foot = after, foot + shift
                acc = accelerations(mode, y[0], y[1], y[2], y[3], u, p)
                book_extremes(y, acc, p, out)
                events += 1
                if force_guard(RELEASE, mode, y, u, pull, p) > 0.0:
                    failure = CONTACT_LOST
            if events > MAX_EVENTS:
                failure = TOO_MANY_EVENTS
        x[PHI], x[THETA], x[DPHI], x[DTHETA] = y
        x[MODE], x[FOOT] = mode, foot
        out[row.TIME] = t
        out[row.DISTANCE] = hub_position(y[0], p)[0] + foot * chord - hub_before
        out[row.STEPS] = foot - foot_before
        energy_after = mechanical_energy(y[0], y[1], y[2], y[3], p) - foot * descent
        out[row.MECHANICAL_CHANGE] = energy_after - energy_before
        out[row.FAILURE] = failure
        return failure

    return advance_kernel


def _source_fingerprint() -> int:
    """Digest of the package's sources: numba looks only at the file of the cached function."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()
    return int.from_bytes(digest[:7], "big")


SOURCE_FINGERPRINT = _source_fingerprint()


#: Compiled: (constants, pole, x, u, duration, pull, out, k) -> failure code of `hybrid`. `x` is
#: advanced in place; `out` (energy.N_ROWS) is overwritten; `k` is `scratch()`; `pull` is the
#: largest force (N) with which the ground holds a foot down: 0, or infinity for a pin joint.
advance_kernel = _kernel(SOURCE_FINGERPRINT)


def _batch(fingerprint: int) -> Callable[..., None]:
    @njit(error_model="numpy", cache=True, nogil=True)
    def advance_batch(constants, poles, states, voltages, duration, pull, out, work):
        fingerprint  # noqa: B018  see above
        x, booked, machine = np.empty(STATE_SIZE), np.empty(row.N_ROWS), np.empty(N_CONSTANTS)
        shared = constants.shape[1] == 1
        for i in range(states.shape[1]):
            c = 0 if shared else i
            machine[:] = constants[:, c]
            x[:] = states[:, i]
            advance_kernel(machine, poles[c], x, voltages[i], duration, pull, booked, work)
            states[:, i] = x
            out[:, i] = booked

    return advance_batch


#: Compiled: advances N hybrid states `states` (STATE_SIZE, N) in place, at `voltages` (N,), on
#: one machine for all, `constants` (N_CONSTANTS, 1), or on one each, (N_CONSTANTS, N);
#: overwrites `out` (energy.N_ROWS, N). `work` is `scratch()`, one per thread.
advance_batch = _batch(SOURCE_FINGERPRINT)


def require_steppable(params: WheelParams) -> None:
    """Refuse machines for which a control interval would take forever.

    Raises:
        ValueError: the motor's pole is faster than `MAX_POLE`.
    """
    if not params.motor_pole <= MAX_POLE:
        raise ValueError(
            f"the motor damps psi' at {params.motor_pole:.3g}/s, faster than the {MAX_POLE:.3g}/s "
            "that stepping allows: raise the inertias or armature_resistance, or lower "
            "motor_constant, gear_ratio or hub_damping"
        )


def scratch() -> NDArray[np.float64]:
    """Work space for one call of the kernel at a time."""
    return np.empty(4 * STAGES)


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
        states: (N, STATE_SIZE), advanced in place.
        voltages: (N,) in V.
        duration: s.
        pull: largest force (N) with which the ground holds a foot down.

    Returns:
        Rows of `rimless_gym.energy` per state, (N, N_ROWS).

    Raises:
        ValueError: see `require_steppable`.
    """
    require_steppable(params)
    out, k = np.empty((len(states), row.N_ROWS)), scratch()
    for i in range(len(states)):
        advance_kernel(
            *(params.constants_array, params.motor_pole, states[i], voltages[i]),
            *(duration, pull, out[i], k),
        )
    return out
