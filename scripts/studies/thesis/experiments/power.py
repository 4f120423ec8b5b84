"""The motor's power during a motion and the load on its foot, as the thesis states them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rimless_gym.equations import equations
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from scripts.studies.thesis.experiments.replay import SAMPLES, sampled_times
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)  # of arrays


@dataclasses.dataclass(frozen=True)
class Powers:
    """Powers at the motor's output as the thesis draws them (W), at times (s), without sign.

    The torque is linear in voltage and rate. `torque` is the power of the part that the voltage
    gives at rest, `passive` that of the part that the rate gives at 0 V, `total` that of both.
    """

    times: Array
    passive: Array
    torque: Array
    total: Array


def powers(params: WheelParams, phase: PhaseTrajectory) -> Powers:
    """The motor's power during a step."""
    times, c = sampled_times(phase), params.constants
    rate, volts = _motor(params, phase, times)
    parts = (
        _eq.motor_torque(rate, 0.0, c),
        _eq.motor_torque(0.0, volts, c),
        _eq.motor_torque(rate, volts, c),
    )
    return Powers(times, *(np.abs(part * rate) for part in parts))


def energy(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """The energy that the thesis reports: the integral of |T psi'| (J)."""
    nodes, weights = np.polynomial.legendre.leggauss(SAMPLES)
    total = 0.0
    for phase in phases:
        h = phase.element_durations
        times = phase.edges[:-1, None] + 0.5 * h[:, None] * (1 + nodes)
        rate, volts = _motor(params, phase, times.ravel())
        power = np.abs(_eq.shaft_power(rate, volts, params.constants))
        total += float(0.5 * h @ (power.reshape(times.shape) @ weights))
    return total


def _motor(params: WheelParams, phase: PhaseTrajectory, times: Array) -> tuple[Array, Array]:
    """psi' (rad/s) and the voltage (V) at times of a phase."""
    x = phase.state(times)
    rate = _eq.relative_rate(x[:, 2], x[:, 3], params.constants)
    return rate, phase.control(times)[:, 0]


def least_normal_force(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """Smallest normal force on the foot, in weights; negative where its pin joint pulls it down."""
    reaction: Any = HybridModel(params).functions["ground_reaction"]
    least = math.inf
    for phase in phases:
        times = sampled_times(phase)
        forces = np.asarray(reaction(phase.state(times).T, phase.control(times).T))
        least = min(least, float(forces[1].min()) / params.weight)
    return least
