"""Solutions replayed on the reference simulator: with their own control, and as the thesis did."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from rimless_gym.params import WheelParams
from rimless_gym.reference import simulate
from rimless_gym.trajectory import Trajectory
from trajopt.gaits.verify import playback, simulated_stride
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory

#: Times per element of a mesh at which motions are compared.
SAMPLES = 24

#: Simulated past the planned end (s) until the last touchdown has happened.
SPARE_TIMES = (1e-8, 1e-7, 1e-6, 1e-5, 1e-3)

#: Below this phi' (rad/s) a step ends without a collision: its leg comes to rest at the guard.
COLLISIONLESS = 1e-6

#: The rate at which the thesis samples controls (Hz), how long we wait for late touchdowns (s),
#: and the tolerances of the simulation.
THESIS_RATE, THESIS_WAITS = 1000.0, (0.02, 0.5, 5.0)
THESIS_RTOL, THESIS_ATOL = 1e-10, 1e-12

#: How far from the planned end the top of a step without a collision is searched for (s).
WITHIN = 0.005

#: The interval over which phi'' is measured where a foot lands before phi' vanishes (s).
SECANT = 1e-6


@dataclasses.dataclass(frozen=True)
class Replay:
    """A motion simulated by the reference simulator, the foot pinned to the ground.

    Attributes:
        times: of the simulated states (s), shape (N,); an event's time is there twice.
        states: shape (N, 4).
        state_error: largest deviation from the solution's states, all steps simulated in one
            (rad, rad/s).
        touchdown_time_errors: one per step (s); infinite if its touchdown did not happen. For a
            step without a collision, the error of the time at which phi' vanishes.
    """

    times: Array
    states: Array
    state_error: float
    touchdown_time_errors: tuple[float, ...]


def replayed(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Replay:
    """Simulate under the solution's own control."""
    return _compared(simulated_stride(params, phases, SPARE_TIMES), phases)


def resampled(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Replay:
    """Simulate as the thesis did: the control linear between its values every millisecond."""
    duration = sum(phase.duration for phase in phases)
    _, own = playback(phases)
    times = np.append(np.arange(0.0, duration, 1 / THESIS_RATE), duration)
    values = np.array([own(t, None) for t in times])

    def linear(t: float, x: Array) -> float:
        return float(np.interp(t, times, values))

    for wait in THESIS_WAITS if phases[-1].end[2] > COLLISIONLESS else THESIS_WAITS[:1]:
        motion = simulate(
            *(params, phases[0].start, linear, duration + wait),
            rtol=THESIS_RTOL,
            atol=THESIS_ATOL,
        )
        if motion.steps >= len(phases):
            break
    return _compared(motion, phases)


def _compared(motion: Trajectory, phases: Sequence[PhaseTrajectory]) -> Replay:
    """Compare step by step, at the times that lie within the simulated step too."""
    times = _landings(motion)[: len(phases)]
    marks = [0.0, *times, *[float(motion.t[-1])] * (len(phases) - len(times))]
    error, begin, errors = 0.0, 0.0, []
    for i, phase in enumerate(phases):
        local = sampled_times(phase)
        at = np.clip(begin + local, marks[i], marks[i + 1])
        states = motion.state(at)
        states[at >= marks[i + 1]] = motion.state(marks[i + 1], side="left")
        error = max(error, float(np.abs(states - phase.state(local)).max()))
        begin += phase.duration
        if abs(phase.end[2]) < COLLISIONLESS:
            errors.append(abs(_top(motion, marks[i], begin) - begin))
        else:
            errors.append(abs(times[i] - begin) if i < len(times) else math.inf)
    return Replay(motion.t, motion.x, error, tuple(errors))


def _landings(motion: Trajectory) -> list[float]:
    """Times of forward touchdowns (s)."""
    return [float(event.time) for event in motion.touchdowns if event.direction > 0]


def _top(motion: Trajectory, after: float, near: float) -> float:
    """Time about `near` at which phi' vanishes (s); extrapolated if the foot lands before."""
    end = next((t for t in _landings(motion) if t > after), float(motion.t[-1]))

    def rate(t: float) -> float:
        return float(motion.state(t, side="left")[2])

    times = np.linspace(max(after, near - WITHIN), min(end, near + WITHIN), 401)
    rates = [rate(t) for t in times]
    tops = [i for i in range(400) if rates[i] > 0 >= rates[i + 1]]
    if not tops:
        slope = (rate(end) - rate(end - SECANT)) / SECANT
        return end - rate(end) / slope
    i = min(tops, key=lambda i: abs(times[i] - near))
    return float(brentq(rate, times[i], times[i + 1], xtol=1e-14))


def sampled_times(phase: PhaseTrajectory) -> Array:
    """Times within a phase, evenly spread over every element, ends included (s)."""
    inside = np.linspace(phase.edges[:-1], phase.edges[1:], SAMPLES, endpoint=False)
    return np.append(inside.T.ravel(), phase.duration)
