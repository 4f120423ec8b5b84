"""A control played back on the wheel's reference simulator, as a function of time alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.reference import simulate
from rimless_gym.trajectory import Trajectory
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory

#: Time around a touchdown (s) within which the simulation is expected to land.
SWITCHED = 1e-6


def playback(
    phases: Sequence[PhaseTrajectory],
) -> tuple[list[float], Callable[[float, Any], float]]:
    """The voltage of phases one after the other, and the times at which it may jump.

    Args:
        phases: each with one control.

    Returns:
        Times (s), and a function (t, x) -> V of t alone, but for `SWITCHED` around a touchdown
        between two phases: there a state shows whether the foot has landed. (The simulation lands a
        picosecond early or late, and the next step's voltage could make the old foot slip.) The
        state may be None. After the end the last element's polynomial goes on.
    """
    begins = np.cumsum([0.0, *(p.duration for p in phases)])
    edges = np.concatenate([b + p.edges[:-1] for b, p in zip(begins, phases, strict=False)])
    edges = np.append(edges, begins[-1])
    polynomials = [element for phase in phases for element in _polynomials(phase)]
    first = np.cumsum([len(p.edges) - 1 for p in phases])

    def law(t: float, x: Any) -> float:
        i = int(np.searchsorted(edges, t, side="right")) - 1
        i = min(max(i, 0), len(polynomials) - 1)
        if x is not None:
            for begin, landed in zip(begins[1:-1], first[:-1], strict=True):
                if abs(t - begin) < SWITCHED:
                    i = int(landed) - (x[0] > math.pi / 2)
        s, value = (t - edges[i]) / (edges[i + 1] - edges[i]), 0.0
        for coefficient in polynomials[i]:
            value = value * s + coefficient
        return float(value)

    return [float(t) for t in edges[1:]], law


def _polynomials(phase: PhaseTrajectory) -> Array:
    """The voltage in every element over [0, 1]: coefficients, highest power first, by element."""
    inverse = np.linalg.inv(np.vander(phase.control_nodes))
    return np.asarray(phase.controls[:, :, 0] @ inverse.T)


def played(params: WheelParams, phases: Sequence[PhaseTrajectory], duration: float) -> Trajectory:
    """Simulate from the start of the phases, under their voltage, for a duration (s)."""
    breakpoints, law = playback(phases)
    return simulate(params, phases[0].start, law, duration, breakpoints=breakpoints)


def played_to_last_touchdown(
    params: WheelParams, phases: Sequence[PhaseTrajectory], spare_times: Sequence[float]
) -> Trajectory:
    """Simulate until there have been as many steps as there are phases.

    The last touchdown is at the very end, but for rounding, so a little more is simulated, under
    the first phase's voltage.

    Args:
        params: the machine.
        phases: one per step.
        spare_times: additions to the phases' duration (s), ascending. The first that is enough for
            the last touchdown is taken; if none is, the last one.
    """
    duration = sum(p.duration for p in phases)
    breakpoints, law = playback([*phases, phases[0]])
    for spare in spare_times:
        run = simulate(params, phases[0].start, law, duration + spare, breakpoints=breakpoints)
        if run.steps >= len(phases):
            break
    return run
