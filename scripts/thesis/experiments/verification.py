"""Solutions under the reference simulator: with their own control, and as the thesis did it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

from rimless_gym.params import WheelParams
from rimless_gym.reference import simulate
from rimless_gym.symbolic import HybridModel
from rimless_gym.trajectory import Trajectory
from trajopt.ocp.arrays import Array
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

SAMPLES = 24  # per element of a mesh

#: Simulated past the last touchdown (s), more where it does not lie within.
SPARE_TIMES = (1e-8, 1e-7, 1e-6, 1e-5, 1e-3)

#: Below this phi' a step ends without a collision (rad/s): its leg comes to rest at the guard.
COLLISIONLESS = 1e-6

#: At which the thesis resamples controls (Hz), and how long we wait for late touchdowns (s).
THESIS_RATE, THESIS_WAITS = 1000.0, (0.02, 0.5, 5.0)
#: Over which phi'' is measured where a foot lands before phi' vanishes (s).
SECANT = 1e-6

#: Of the planned end, the top of a step that ends without a collision is looked for (s).
WITHIN = 0.005

THESIS_RTOL, THESIS_ATOL = 1e-10, 1e-12


@dataclasses.dataclass(frozen=True)
class Verification:
    """What the reference simulator makes of a motion, foot pinned to the ground.

    Attributes:
        times: at which the simulated motion is known (s), those of events twice.
        states: there, shape (N, 4).
        state_error: largest deviation from the solution's states, all steps in one (rad, rad/s).
        touchdown_time_errors: of every touchdown (s); infinite if it did not happen. A step that
            ends without a collision has the time at which phi' vanishes instead.
        final_rate: phi' at the last touchdown, or where the motion ends without it (rad/s).
    """

    times: Array
    states: Array
    state_error: float
    touchdown_time_errors: tuple[float, ...]
    final_rate: float


def verified(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Verification:
    """Simulate under the solution's own control."""
    ends = np.cumsum([phase.duration for phase in phases])
    begins = ends - [phase.duration for phase in phases]
    edges = np.concatenate([b + p.edges for b, p in zip(begins, phases, strict=True)])
    for spare in SPARE_TIMES:
        motion = _simulated(params, phases, ends[-1] + spare, edges)
        if len(_landings(motion)) == len(phases):
            break
    return _compared(motion, phases)


def resampled(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Verification:
    """Simulate as the thesis did: the control linear between its values every millisecond."""
    duration = sum(phase.duration for phase in phases)
    own = _control(phases)
    times = np.append(np.arange(0.0, duration, 1 / THESIS_RATE), duration)
    values = np.array([own(t) for t in times])

    def linear(t: float, x: Array) -> float:
        return float(np.interp(t, times, values))

    for wait in THESIS_WAITS if phases[-1].end[2] > COLLISIONLESS else THESIS_WAITS[:1]:
        motion = simulate(
            *(params, phases[0].start, linear, duration + wait),
            rtol=THESIS_RTOL,
            atol=THESIS_ATOL,
        )
        if len(_landings(motion)) >= len(phases):
            break
    return _compared(motion, phases)


def _simulated(
    params: WheelParams, phases: Sequence[PhaseTrajectory], duration: float, edges: Array
) -> Trajectory:
    law = _control(phases)
    return simulate(
        params, phases[0].start, lambda t, x: law(t), duration, breakpoints=edges.tolist()
    )


def _control(phases: Sequence[PhaseTrajectory]) -> Callable[[float], float]:
    """The control of steps one after the other; after the last, as it was at its end."""
    ends = np.cumsum([phase.duration for phase in phases])

    def law(t: float) -> float:
        index = min(int(np.searchsorted(ends, t, side="right")), len(phases) - 1)
        phase = phases[index]
        local = min(t - (ends[index] - phase.duration), phase.duration)
        return float(phase.control(local)[0, 0])

    return law


def _compared(motion: Trajectory, phases: Sequence[PhaseTrajectory]) -> Verification:
    """Step by step, each on the times at which the simulated one lasts too."""
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
    last = motion.state(marks[-1], side="left")
    return Verification(motion.t, motion.x, error, tuple(errors), float(last[2]))


def _landings(motion: Trajectory) -> list[float]:
    """Times of forward touchdowns (s)."""
    return [float(event.time) for event in motion.touchdowns if event.direction > 0]


def _top(motion: Trajectory, after: float, near: float) -> float:
    """When phi' vanishes about the time `near`, continued where the foot lands before (s)."""
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


@dataclasses.dataclass(frozen=True)
class Powers:
    """Powers at the motor's output as the thesis draws them (W), at times (s).

    Torque is T = (K / Rm) V - (K^2 / Rm) theta': the first part alone gives `torque`, the other
    one `passive`, both together `total`, all of them without sign.
    """

    times: Array
    passive: Array
    torque: Array
    total: Array

    @property
    def energy(self) -> float:
        """Integral of the total power (J)."""
        return float(np.trapezoid(self.total, self.times))


def powers(params: WheelParams, phase: PhaseTrajectory) -> Powers:
    """The motor's power during a step."""
    times, c = sampled_times(phase), params.constants
    x, volts = phase.state(times), phase.control(times)[:, 0]
    rate = x[:, 3] + c.d1 * x[:, 2]
    torque, passive = c.K * c.G * volts * rate, c.K**2 * c.G * rate**2
    return Powers(times, np.abs(passive), np.abs(torque), np.abs(torque - passive))


def energy(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """The thesis's: integral of |T psi'|, mount `frame`'s psi' being theta' (J)."""
    nodes, weights = np.polynomial.legendre.leggauss(SAMPLES)
    c, total = params.constants, 0.0
    for phase in phases:
        h = phase.element_durations
        times = phase.edges[:-1, None] + 0.5 * h[:, None] * (1 + nodes)
        x, volts = phase.state(times.ravel()), phase.control(times.ravel())[:, 0]
        rate = x[:, 3] + c.d1 * x[:, 2]
        power = np.abs(c.K * c.G * (volts - c.K * rate) * rate).reshape(times.shape)
        total += float(0.5 * h @ (power @ weights))
    return total


def least_normal_force(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """Smallest normal force on the foot, in weights; negative where its pin joint pulls it down."""
    reaction: Any = HybridModel(params).functions["ground_reaction"]
    least = math.inf
    for phase in phases:
        times = sampled_times(phase)
        forces = np.asarray(reaction(phase.state(times).T, phase.control(times).T))
        least = min(least, float(forces[1].min()) / params.weight)
    return least
