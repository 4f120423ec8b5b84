"""How high the foot that comes down next is above the ground, by the reference simulator."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rimless_gym import WheelParams, hybrid
from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.attempt import MAX_POLE_STEP, MAX_RATE_STEP
from rimless_gym.kernel.integration import smooth_states
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.trajectory import Event, Trajectory

Array = NDArray[np.float64]


def foot_height(params: WheelParams, phi: float, direction: int) -> float:
    """Height (m) of the foot that comes down next if the wheel turns in `direction` (1 or -1)."""
    p, swing = params.constants, phi - direction * params.leg_angle
    return float(hybrid.hub_position(phi, p)[1] - hybrid.hub_position(swing, p)[1])


def dip(
    params: WheelParams, y: Sequence[float], u: float, duration: float, direction: int
) -> float:
    """How deep (m) the foot goes below the ground before it comes up; 0 if it does not come up."""
    states = smooth_states(params, tuple(y), u, duration, 400)
    heights = np.array([foot_height(params, state[0], direction) for state in states])
    below = np.flatnonzero(heights < 0)
    back = np.flatnonzero(heights[below[0] :] > 0) if len(below) else below
    return float(-heights[below[0] : below[0] + back[0]].min()) if len(back) else 0.0


def height_at_touchdown(reference: Trajectory, event: Event, volts: Array) -> float:
    """Height (m) of the foot by the reference when the kernel finds this touchdown.

    The kernel starts from the reference's state half of its longest step earlier, or at the last
    event or change of the voltage if that is later. If it misses the touchdown, the depth of the
    dip counts.

    Args:
        reference: the motion.
        event: a touchdown in it.
        volts: voltages of the control intervals.
    """
    params = reference.params
    interval = max(math.ceil(event.time / CONTROL_PERIOD - 1e-9) - 1, 0)
    earlier = [other.time for other in reference.events if other.time < event.time]
    begin = max([interval * CONTROL_PERIOD, *earlier])
    rates = max(np.abs(reference.state(begin)[2:]).sum(), 1e-9)
    limit = min(CONTROL_PERIOD, MAX_POLE_STEP / params.motor_pole, MAX_RATE_STEP / rates)
    t, u = max(begin, event.time - limit / 2), volts[interval]
    start = np.zeros((1, STATE_SIZE))
    start[0, :4] = y = reference.state(t)
    duration, touchdowns = event.time - t + limit / 2, 2.0
    while touchdowns > 1:  # until only the first is left
        out = advance(params, start.copy(), np.array([u]), duration, pull=math.inf)[0]
        touchdowns, duration = out[ROW.touchdowns], out[ROW.touchdown_time] * (1 - 1e-12)
    if out[ROW.touchdowns] == 0:
        return dip(params, tuple(y), u, CONTROL_PERIOD, event.direction)
    t += out[ROW.touchdown_time]
    arc = next(arc for arc in reference.arcs if arc.end == event.time)
    return abs(foot_height(params, arc.dense(t)[0], event.direction))
