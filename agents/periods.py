"""After how many steps a walk repeats."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.rollout import Interval
from rimless_gym.envs.layout import LEG_RATE_SCALE, PENDULUM_RATE_SCALE
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import accelerations
from rimless_gym.kernel.stepping import DPHI, DTHETA, FOOT, MODE, PHI, THETA
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: Longest period looked for (steps).
MAX_PERIOD = 6

#: Post-touchdown states (scaled as observations are) this close to each other count as the same.
#: Touchdowns fall anywhere within a hold of 10 ms, so even a perfect gait scatters.
TOLERANCE = 0.03


class TouchdownLog:
    """States just after each touchdown on a new foot, of N walks side by side.

    Args:
        params: the machine. Where walks have machines of their own or their commands are delayed,
            the states are as good as if they had this one and were not.
        n: number of walks.
    """

    def __init__(self, params: WheelParams, n: int) -> None:
        self._params = params
        self._furthest = np.full(n, -np.inf)
        self._points: list[list[Floats]] = [[] for _ in range(n)]

    def note(self, interval: Interval) -> None:
        """Add the touchdowns of a control interval."""
        foot = interval.after[:, FOOT]
        stepped = (foot > self._furthest[interval.running]) & (interval.info["steps"] > 0)
        for k in np.flatnonzero(stepped):
            i = interval.running[k]
            volts = interval.actions[k] * self._params.voltage_limit
            self._furthest[i] = foot[k]
            self._points[i].append(_just_after_touchdown(self._params, interval.after[k], volts))

    def points(self) -> list[Floats]:
        """For each walk, its scaled post-touchdown states (touchdowns, 4)."""
        return [np.array(points).reshape(-1, 4) for points in self._points]


def _just_after_touchdown(params: WheelParams, state: Floats, volts: float) -> Floats:
    """(sin theta, cos theta, phi', theta'), scaled, at the touchdown up to 10 ms before `state`.

    It follows the motion back at constant acceleration, which is accurate to third order.
    """
    p = params.constants
    phi, theta, dphi, dtheta = (float(state[k]) for k in (PHI, THETA, DPHI, DTHETA))
    if int(state[MODE]) == SINGLE and dphi > 0:
        ddphi, ddtheta = accelerations(SINGLE, phi, theta, dphi, dtheta, volts, p)
        dt = (phi - p.a) / dphi
        dt = (phi - p.a + 0.5 * ddphi * dt**2) / dphi  # one fixed-point step of the quadratic
        theta += -dtheta * dt + 0.5 * ddtheta * dt**2
        dphi, dtheta = dphi - ddphi * dt, dtheta - ddtheta * dt
    return np.array(
        [np.sin(theta), np.cos(theta), dphi / LEG_RATE_SCALE, dtheta / PENDULUM_RATE_SCALE]
    )


def steps_per_period(points: Floats) -> int:
    """Smallest number of steps after which post-touchdown states repeat, 0 if none up to 6.

    Args:
        points: scaled post-touchdown states, (touchdowns, 4).
    """
    for k in range(1, MAX_PERIOD + 1):
        if len(points) < 3 * k:
            return 0
        distance: NDArray[np.float64] = points[k:] - points[:-k]
        if np.sqrt(np.mean(np.sum(distance**2, axis=1))) < TOLERANCE:
            return k
    return 0
