"""Lookahead: the constant voltage from which another law gets nearest to its gait.

Far from a gait, at rest for example, linear feedback means little. The lookahead plays a few
constant voltages forward on the stepping kernel, the other law taking over after each, and chooses
the one that comes nearest to the gait without losing contact (a rollout: Bertsekas, Dynamic
Programming and Optimal Control, 6.4). It remains a function of the state alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD, DOUBLE
from rimless_gym.kernel.stepping import (
    MODE,
    STATE_SIZE,
    advance_batch,
    machine_arrays,
    scratch,
)
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: Scores, in squared distances from the gait: added per control period that passes before the gait
#: is near, added while the wheel rests on two feet, and for a fall.
DELAY, RESTING, FALL = 0.005, 2.0, 1e6


class Follower(NamedTuple):
    """A law in compiled form, which a rollout can call.

    Attributes:
        follow: (x (4,), data) -> (voltage, squared distance from the gait); compiled by numba.
        data: what it needs besides the state, a NamedTuple of arrays and numbers.
    """

    follow: Callable[[Any, Any], tuple[float, float]]
    data: NamedTuple


class Plan(NamedTuple):
    """What is tried.

    Attributes:
        candidates: voltages (V), shape (m,).
        hold: number of control periods for which each is held.
        horizon: number of control periods played forward, more than `hold`.
    """

    candidates: Floats
    hold: int = 12
    horizon: int = 90


class Machine(NamedTuple):
    """What the stepping kernel needs of a machine; see `rimless_gym.kernel.stepping`."""

    constants: Floats
    poles: Floats
    work: Floats


@dataclasses.dataclass(frozen=True)
class Lookahead:
    """The candidate voltage after which a law gets nearest to its gait, or the law's own voltage.

    Attributes:
        params: the machine.
        follower: the law that takes over after a candidate.
        plan: what is tried.
    """

    params: WheelParams
    follower: Follower
    plan: Plan

    def __call__(self, x: Floats, mode: NDArray[np.int64]) -> Floats:
        """Voltages (N,) for states (N, 4) and stance modes (N,)."""
        machine = Machine(*machine_arrays([self.params]), scratch())
        volts: Floats = _best_first(x, mode, *self.follower, self.plan, machine)
        return volts


@njit(error_model="numpy")
def _best_first(x, mode, follow, data, plan, machine):  # type: ignore[no-untyped-def]
    m = len(plan.candidates)
    tries = m + 1  # the last one is the law's own voltage
    volts, u = np.empty(len(x)), np.empty(tries)
    moving, out = np.empty((STATE_SIZE, tries)), np.empty((len(ROW), tries))
    for i in range(len(x)):
        own, _ = follow(x[i], data)
        u[:m], u[m] = plan.candidates, own
        moving[:] = 0.0
        for k in range(tries):
            moving[:4, k] = x[i]
        moving[MODE] = mode[i]
        scores = _scores(moving, u, out, follow, data, plan, machine)
        best = np.argmin(scores)
        volts[i] = plan.candidates[best] if scores[best] < scores[m] else own
    return volts


@njit(error_model="numpy")
def _scores(moving, u, out, follow, data, plan, machine):  # type: ignore[no-untyped-def]
    """How near to the gait each column of `moving` gets that begins with the voltage in `u`."""
    tries = len(u)
    scores, fallen = np.full(tries, np.inf), np.zeros(tries, dtype=np.bool_)
    for step in range(plan.horizon):
        advance_batch(
            *(machine.constants, machine.poles, moving, u, 0, tries),
            *(CONTROL_PERIOD, 0.0, out, machine.work),
        )
        for k in range(tries):
            if fallen[k]:
                continue
            if out[ROW.failure, k] != 0.0:
                scores[k], fallen[k] = FALL - step, True
                continue
            volts, distance = follow(moving[:4, k], data)
            if step >= plan.hold:
                resting = RESTING if moving[MODE, k] == DOUBLE else 0.0
                scores[k] = min(scores[k], distance + DELAY * step + resting)
            if step + 1 >= plan.hold or k == tries - 1:
                u[k] = volts
    return scores
