"""Transverse LQR about a gait at 100 Hz: a memoryless law that holds it, and an expert to clone.

The orbit is a table of points one control period apart. A state is projected onto it, in a metric
in which all four coordinates vary alike along the gait; what remains is the deviation across the
orbit, for where along it the wheel is matters to nobody. The gains are those of the periodic
discrete-time LQR of these transverse deviations under the zero-order hold, touchdowns included
(Shiriaev, Freidovich and Gusev, IEEE TAC 2010, for the transverse coordinates; Bittanti, Colaneri
and De Nicolao, The Riccati Equation, 1991, for the periodic recursion).

Far from the orbit, at rest for one, linear feedback means little. There the law looks ahead:
it plays a few constant voltages forward on the stepping kernel, with the LQR after them, and
takes the one that comes nearest to the orbit without losing contact (a rollout, Bertsekas,
Dynamic Programming and Optimal Control, 6.4). It is still a function of the state alone.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from rimless_gym import energy as row
from rimless_gym.checks import positive, real_array, require_kind
from rimless_gym.hybrid import CONTROL_PERIOD, DOUBLE, SINGLE
from rimless_gym.kernel.stepping import STATE_SIZE, advance, advance_batch, machine_arrays, scratch
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.gaits.solution import Solution

Array = NDArray[np.float64]

DIFFERENCE = 1e-6  # of the central differences (rad, rad/s)


@dataclasses.dataclass(frozen=True)
class LimitCycleLqr:
    """u = V*(s) - K(s) (x - x*(s)), s the orbit's point nearest to x; with lookahead far off.

    Attributes:
        params: the machine.
        states: points of the orbit, shape (n, 4); from each to the next takes `period`.
        voltages: held from there on, shape (n,).
        gains: K at the points, shape (n, 4).
        metric: weights of the squared coordinates in the search for the nearest point, shape (4,).
        period: between neighbouring points (s), about 0.01.
        near: distance in the metric up to which the LQR is trusted alone.
        candidates: voltages that the lookahead tries (V), shape (m,).
        hold: for how many control periods it holds them.
        horizon: how many control periods it looks ahead.
    """

    params: WheelParams
    states: Array
    voltages: Array
    gains: Array
    metric: Array
    period: float
    near: float = 0.5
    candidates: Array = dataclasses.field(default_factory=lambda: np.linspace(-20.0, 20.0, 11))
    hold: int = 12
    horizon: int = 90

    @classmethod
    def from_solution(
        cls, solution: Solution, *, effort: float = 0.1, near: float = 0.5
    ) -> LimitCycleLqr:
        """The law for a gait.

        Args:
            solution: the gait.
            effort: price of a volt squared against a squared deviation of one standard
                deviation of the gait's own motion.
            near: distance, in such standard deviations, up to which the LQR is trusted alone.

        Raises:
            TypeError: an argument is of the wrong kind.
            ValueError: a number is not finite and positive.
        """
        require_kind("solution", solution, Solution)
        effort, near = positive("effort", effort), positive("near", near)
        params, n = solution.params, max(8, round(solution.duration / CONTROL_PERIOD - 1e-6))
        period = solution.duration / n
        t: Array = period * np.arange(0.5, n)
        states, voltages = solution.state(t), mean_voltage(solution, t, period)
        metric = 1.0 / np.var(states, axis=0)
        if solution.theta_turns:  # theta runs round the circle; so does its deviation
            metric[1] = 0.5
        flow = HybridModel(params).functions["flow"].map(n)
        tangents = np.asarray(flow(states.T, solution.control(t)[None])).T
        gains = _gains(params, states, voltages, period, tangents, metric, effort)
        gains -= _advance_along_orbit(solution, t, period, tangents, metric)
        volts = np.linspace(-params.voltage_limit, params.voltage_limit, 11)
        return cls(params, states, voltages, gains, metric, period, near, volts)

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Array:
        """Voltages for states.

        Args:
            x: states, shape (N, 4) or (4,).
            mode: stance modes, shape (N,) or a scalar.

        Returns:
            Volts within the limit, shape (N,) or ().

        Raises:
            TypeError: states or modes are no numbers.
            ValueError: they are of another shape.
        """
        batch = np.atleast_2d(real_array("x", x))
        if batch.ndim != 2 or batch.shape[1] != 4:
            raise ValueError(f"x: of shape {np.shape(x)}, not (4,) or (N, 4)")
        modes = real_array("mode", mode)
        if modes.shape not in ((), (1,), (len(batch),)):
            raise ValueError(f"mode: of shape {modes.shape}, not () or ({len(batch)},)")
        if not np.isin(modes, (SINGLE, DOUBLE)).all():
            raise ValueError(
                f"mode = {mode!r}: must be {SINGLE} or {DOUBLE}, single or double stance"
            )
        batch = np.ascontiguousarray(batch, dtype=np.float64)
        modes = np.broadcast_to(modes.astype(np.int64), len(batch))
        volts = _law(
            *(batch, modes, self.states, self.voltages, self.gains, self.metric),
            *(self.near, self.candidates, self.hold, self.horizon),
            *(self.params.voltage_limit, *machine_arrays([self.params]), scratch()),
        )
        return volts if np.ndim(x) == 2 else volts[0]


def mean_voltage(solution: Solution, t: Array, period: float) -> Array:
    """Mean of the gait's voltage over [t, t + period], shape (N,): what a hold comes nearest to."""
    s, weights = np.polynomial.legendre.leggauss(16)
    times = t[:, None] + 0.5 * period * (s + 1)
    return np.asarray(0.5 * solution.control(times.ravel()).reshape(times.shape) @ weights)


def _gains(
    params: WheelParams,
    states: Array,
    voltages: Array,
    period: float,
    tangents: Array,
    metric: Array,
    effort: float,
) -> Array:
    n = len(states)
    A, B = held_dynamics(params, states, voltages, period)
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


def _advance_along_orbit(
    solution: Solution, t: Array, period: float, tangents: Array, metric: Array
) -> Array:
    """Change of the gait's voltage with the state's lead over the table's point, shape (n, 4)."""
    lead = 0.25 * period
    later, earlier = (mean_voltage(solution, t + sign * lead, period) for sign in (1, -1))
    trend = (later - earlier) / (2 * lead)
    weighted = tangents * metric
    time_ahead = weighted / np.sum(weighted * tangents, axis=1, keepdims=True)
    return np.asarray(trend[:, None] * time_ahead)


def held_dynamics(
    params: WheelParams, states: Array, voltages: Array, period: float
) -> tuple[Array, Array]:
    """Derivatives of the state after a held period: A (n, 4, 4) by the state, B (n, 4, 1) by V.

    Central differences of the stepping kernel, whose touchdowns are located exactly, so that a
    period with a touchdown in it is differentiated like any other.
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


def transverse(tangent: Array, metric: Array) -> tuple[Array, Array]:
    """Coordinates across the orbit: (into (3, 4), out (4, 3)).

    `into` forgets motion along the tangent; `out` spans what is orthogonal to it in the metric.
    """
    scale = np.sqrt(metric)
    unit = scale * tangent / np.linalg.norm(scale * tangent)
    basis = np.linalg.qr(np.column_stack([unit, np.eye(4)]))[0][:, 1:]
    return basis.T * scale, basis / scale[:, None]


@njit(error_model="numpy")
def _nearest(x, states, metric):  # type: ignore[no-untyped-def]
    """Index of the nearest point of the orbit, and its squared distance."""
    best, nearest = np.inf, 0
    for j in range(len(states)):
        d0, d1 = x[0] - states[j, 0], x[1] - states[j, 1]
        d2, d3 = x[2] - states[j, 2], x[3] - states[j, 3]
        d1 -= 2 * np.pi * np.round(d1 / (2 * np.pi))
        distance = metric[0] * d0**2 + metric[1] * d1**2 + metric[2] * d2**2 + metric[3] * d3**2
        if distance < best:
            best, nearest = distance, j
    return nearest, best


@njit(error_model="numpy")
def _feedback(x, j, states, voltages, gains, limit):  # type: ignore[no-untyped-def]
    """The LQR about point j."""
    u = voltages[j]
    for c in range(4):
        d = x[c] - states[j, c]
        if c == 1:
            d -= 2 * np.pi * np.round(d / (2 * np.pi))
        u -= gains[j, c] * d
    return min(max(u, -limit), limit)


@njit(error_model="numpy")
def _law(  # type: ignore[no-untyped-def]
    x,
    mode,
    states,
    voltages,
    gains,
    metric,
    near,
    candidates,
    hold,
    horizon,
    limit,
    constants,
    poles,
    work,
):
    volts, tries = np.empty(len(x)), len(candidates) + 1  # the last tries the feedback alone
    moving, u, out = np.empty((STATE_SIZE, tries)), np.empty(tries), np.empty((row.N_ROWS, tries))
    for i in range(len(x)):
        j, distance = _nearest(x[i], states, metric)
        volts[i] = _feedback(x[i], j, states, voltages, gains, limit)
        if mode[i] != DOUBLE and distance <= near**2:
            continue
        for m in range(tries):
            moving[:4, m] = x[i]
        moving[4], moving[5] = mode[i], 0.0
        score, ended = np.full(tries, np.inf), np.zeros(tries)
        for step in range(horizon):
            for m in range(tries):
                if m < len(candidates) and step < hold:
                    u[m] = candidates[m]
                else:
                    j, _ = _nearest(moving[:, m], states, metric)
                    u[m] = _feedback(moving[:, m], j, states, voltages, gains, limit)
            advance_batch(constants, poles, moving, u, 0, tries, 0.01, 0.0, out, work)
            for m in range(tries):
                if ended[m]:
                    continue
                if out[row.FAILURE, m] != 0.0:
                    score[m], ended[m] = 1e6 - step, 1.0
                elif step >= hold:
                    _, distance = _nearest(moving[:, m], states, metric)
                    resting = (moving[4, m] == DOUBLE) * 2.0
                    score[m] = min(score[m], distance + 0.005 * step + resting)
        best = np.argmin(score)
        if best < len(candidates) and score[best] < score[-1]:
            volts[i] = candidates[best]
    return volts
