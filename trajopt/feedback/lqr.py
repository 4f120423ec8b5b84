"""Transverse LQR about a gait, at 100 Hz.

The gait's orbit is a table of points one control period apart. The law finds the point nearest to
the state, in a metric in which all four coordinates vary alike along the gait, and feeds back the
deviation from it. Only deviations across the orbit count: being early or late on the gait is no
error. The gains are those of the periodic discrete-time LQR of these transverse deviations under
the zero-order hold, touchdowns included (Shiriaev, Freidovich and Gusev, IEEE TAC 2010, for the
transverse coordinates; Bittanti, Colaneri and De Nicolao, The Riccati Equation, 1991, for the
periodic recursion).
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rimless_gym.checks import positive, require_kind
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution

#: Of the central differences (rad, rad/s, V).
DIFFERENCE = 1e-6

#: Fewest points of an orbit's table: for a very short stride, so that neighbours are near.
FEWEST_POINTS = 8


class Orbit(NamedTuple):
    """A gait as a table of n points, with the feedback at each.

    Attributes:
        states: shape (n, 4).
        voltages: held from each point to the next (V), shape (n,).
        gains: volts per deviation of the state, shape (n, 4).
        metric: weights of the squared coordinates in the distance from a point, shape (4,).
        limit: largest voltage (V).
    """

    states: Floats
    voltages: Floats
    gains: Floats
    metric: Floats
    limit: float


@dataclasses.dataclass(frozen=True)
class TransverseLqr:
    """u = V_j - K_j (x - x_j) with j the orbit's point nearest to x, within the voltage limit.

    Attributes:
        orbit: the table.
        period: time from one of its points to the next (s), about 0.01.
    """

    orbit: Orbit
    period: float

    @classmethod
    def from_solution(cls, solution: Solution, *, effort: float = 0.1) -> TransverseLqr:
        """The LQR about a gait.

        Args:
            solution: the gait.
            effort: cost of a squared volt, where a squared deviation of one standard deviation of
                the gait's own motion costs 1; > 0.

        Raises:
            TypeError: an argument is of the wrong type.
            ValueError: `effort` is not finite and positive.
        """
        require_kind("solution", solution, Solution)
        effort = positive("effort", effort)
        params = solution.params
        # Half a period is rounded down, so that rounding errors do not decide.
        n = max(FEWEST_POINTS, round(solution.duration / CONTROL_PERIOD - 1e-6))
        period = solution.duration / n
        t: Floats = np.asarray(period * (np.arange(n) + 0.5))  # away from the touchdown at t = 0
        states, voltages = solution.state(t), mean_voltage(solution, t, period)
        metric = 1.0 / np.var(states, axis=0)
        if solution.theta_turns:  # theta goes round and round: its variance means nothing
            metric[1] = 0.5
        flow = HybridModel(params).functions["flow"].map(n)
        tangents = np.asarray(flow(states.T, solution.control(t)[None])).T
        A, B = held_dynamics(params, states, voltages, period)
        gains = _gains(A, B, tangents, metric, effort)
        gains -= _voltage_along_orbit(solution, t, period, tangents, metric)
        return cls(Orbit(states, voltages, gains, metric, params.voltage_limit), period)

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        """Voltages (N,) and squared distances from the orbit (N,) for states (N, 4)."""
        volts, squared_distances = _followed(x, self.orbit)
        return volts, squared_distances


def mean_voltage(solution: Solution, t: Floats, period: float) -> Floats:
    """Mean of the gait's voltage over [t, t + period], shape (N,): the nearest to it when held."""
    knots = np.concatenate([[0.0], solution.breakpoints])
    sums = np.cumsum([0.0, *_integrals(solution, knots[:-1], knots[1:])])

    def integral(times: Floats) -> Floats:
        """From the stride's start (V s)."""
        strides, within = np.divmod(times, solution.duration)
        last = np.searchsorted(knots, within, side="right") - 1
        last = np.minimum(last, len(knots) - 2)
        rest = _integrals(solution, knots[last], within)
        return np.asarray(strides * sums[-1] + sums[last] + rest)

    return (integral(t + period) - integral(t)) / period


def _integrals(solution: Solution, begins: Floats, ends: Floats) -> Floats:
    """Integrals (V s) of the voltage between times without a breakpoint between them, (N,)."""
    s, weights = np.polynomial.legendre.leggauss(16)
    half = 0.5 * (ends - begins)
    times = begins[:, None] + half[:, None] * (s + 1)
    return np.asarray(half * (solution.control(times.ravel()).reshape(times.shape) @ weights))


def held_dynamics(
    params: WheelParams, states: Floats, voltages: Floats, period: float
) -> tuple[Floats, Floats]:
    """Derivatives of the state after a held period: A (n, 4, 4) by the state, B (n, 4, 1) by V.

    Central differences of the stepping kernel. It locates touchdowns exactly, so a period that
    contains one is differentiated like any other.
    """
    n, columns = len(states), []
    for i in range(5):
        ends = []
        for sign in (1.0, -1.0):
            batch, volts = np.zeros((n, STATE_SIZE)), voltages.copy()
            batch[:, :4] = states
            if i < 4:
                batch[:, i] += sign * DIFFERENCE
            else:
                volts += sign * DIFFERENCE
            advance(params, batch, volts, period, pull=math.inf)
            ends.append(batch[:, :4])
        columns.append((ends[0] - ends[1]) / (2 * DIFFERENCE))
    jacobian = np.stack(columns, axis=2)
    return jacobian[:, :, :4], jacobian[:, :, 4:]


def transverse(tangent: Floats, metric: Floats) -> tuple[Floats, Floats]:
    """Coordinates across the orbit: (into (3, 4), out (4, 3)).

    `into` maps motion along the tangent to 0; the columns of `out` are orthogonal to the tangent
    in the metric.
    """
    scale = np.sqrt(metric)
    unit = scale * tangent / np.linalg.norm(scale * tangent)
    basis = np.linalg.qr(np.column_stack([unit, np.eye(4)]))[0][:, 1:]
    return basis.T * scale, basis / scale[:, None]


def _gains(A: Floats, B: Floats, tangents: Floats, metric: Floats, effort: float) -> Floats:
    """Gains (n, 4) of the periodic LQR, by sweeps of its Riccati recursion round the orbit."""
    n = len(A)
    into, out = zip(*(transverse(f, metric) for f in tangents), strict=True)
    P = np.eye(3)
    gains = np.zeros((n, 1, 3))
    for sweep in range(200):
        last = P
        for j in range(n - 1, -1, -1):
            following = (j + 1) % n
            a, b = into[following] @ A[j] @ out[j], into[following] @ B[j]
            gains[j] = np.linalg.solve(effort + b.T @ P @ b, b.T @ P @ a)
            P = np.eye(3) + a.T @ P @ (a - b @ gains[j])
            P = 0.5 * (P + P.T)
        if sweep and np.allclose(P, last, rtol=1e-9, atol=0.0):
            break
    return np.stack([gains[j, 0] @ into[j] for j in range(n)])


def _voltage_along_orbit(
    solution: Solution, t: Floats, period: float, tangents: Floats, metric: Floats
) -> Floats:
    """Change of the gait's voltage as the state moves on between the table's points (n, 4)."""
    lead = 0.25 * period
    later, earlier = (mean_voltage(solution, t + sign * lead, period) for sign in (1, -1))
    trend = (later - earlier) / (2 * lead)
    weighted = tangents * metric
    time_ahead = weighted / np.sum(weighted * tangents, axis=1, keepdims=True)
    return np.asarray(trend[:, None] * time_ahead)


@njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def follow(x, orbit):  # type: ignore[no-untyped-def]
    """The voltage for a state, and the state's squared distance from the orbit; compiled.

    Only for callers that are compiled too: it has no wrapper for Python, which takes seconds.
    """
    states, metric = orbit.states, orbit.metric
    best, j = np.inf, 0
    for i in range(len(states)):
        d0, d1 = x[0] - states[i, 0], x[1] - states[i, 1]
        d2, d3 = x[2] - states[i, 2], x[3] - states[i, 3]
        d1 -= 2 * np.pi * np.round(d1 / (2 * np.pi))
        distance = metric[0] * d0**2 + metric[1] * d1**2 + metric[2] * d2**2 + metric[3] * d3**2
        if distance < best:
            best, j = distance, i
    u = orbit.voltages[j]
    for c in range(4):
        d = x[c] - states[j, c]
        if c == 1:
            d -= 2 * np.pi * np.round(d / (2 * np.pi))
        u -= orbit.gains[j, c] * d
    return min(max(u, -orbit.limit), orbit.limit), best


@njit(error_model="numpy")
def _followed(x, orbit):  # type: ignore[no-untyped-def]
    volts, squared_distances = np.empty(len(x)), np.empty(len(x))
    for i in range(len(x)):
        volts[i], squared_distances[i] = follow(x[i], orbit)
    return volts, squared_distances
