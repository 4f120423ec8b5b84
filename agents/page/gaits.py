"""The front of least cost of transport for a page: its gaits, sampled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.page.packing import packed
from rimless_gym.equations import LOSSES, equations
from rimless_gym.params import WheelParams
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.solution import Solution

SAMPLED = 0.008  # s: the longest time between two samples of a gait
FINE = 16  # points per sample, over which power is integrated

#: What is sampled: angles (rad), voltage (V), power drawn (W) and energy drawn since the stride
#: began (J), both with the idle power and without regeneration.
COLUMNS = ("phi", "theta", "voltage", "power", "energy")

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


def front_data(front: CotFront) -> list[dict[str, Any]]:
    """The envelope of a front as JSON values, one entry per gait, in order of speed."""
    return [_gait(gait) for gait in front.envelope]


def _gait(gait: Solution) -> dict[str, Any]:
    durations: list[float] = []
    samples: list[NDArray[np.float64]] = []
    energy = 0.0
    spent = dict.fromkeys((*LOSSES, "collision", "idle", "returned"), 0.0)
    for step, phase in enumerate(gait.phases):
        count = math.ceil(phase.duration / SAMPLED)
        t = np.linspace(0.0, phase.duration, count * FINE + 1)
        columns, lost = _walked(gait.params, phase.state(t), phase.control(t)[:, 0], t)
        columns[-1] += energy
        energy = float(columns[-1, -1])
        durations.append(phase.duration)
        samples.append(columns[:, ::FINE])
        for name, joules in lost.items():
            spent[name] += joules
        following = gait.phases[(step + 1) % gait.steps].start
        spent["collision"] += _collision(gait.params, phase.end, following)
    return {
        "speed": gait.speed,
        "cot": gait.cot,
        "turns": gait.theta_turns,
        "durations": durations,
        "counts": [columns.shape[1] for columns in samples],
        "samples": packed(np.concatenate(samples, axis=1)),
        "spent": spent,
    }


def _walked(
    params: WheelParams, x: NDArray[np.float64], u: NDArray[np.float64], t: NDArray[np.float64]
) -> tuple[NDArray[np.float64], dict[str, float]]:
    """The `COLUMNS` over a step, and what became of its energy (J)."""
    p, (phi, theta, dphi, dtheta) = params.constants, x.T
    acc = _eq.single_stance(phi, theta, dphi, dtheta, u, p)
    dpsi = _eq.relative_rate(dphi, dtheta, p)
    electrical = _eq.electrical_power(dpsi, u, p)
    powers = _eq.losses(dphi, dpsi, _eq.relative_rate(*acc, p), u, p)._asdict()
    powers |= {"idle": np.full_like(t, params.idle_power), "returned": np.maximum(-electrical, 0)}
    drawn = np.maximum(electrical, 0.0) + params.idle_power
    steps = 0.5 * (drawn[1:] + drawn[:-1]) * np.diff(t)
    energy = np.append(0.0, np.cumsum(steps))
    lost = {name: float(np.trapezoid(power, t)) for name, power in powers.items()}
    return np.stack([phi, theta, u, drawn, energy]), lost


def _collision(
    params: WheelParams, before: NDArray[np.float64], after: NDArray[np.float64]
) -> float:
    """Energy lost in a forward touchdown (J)."""
    p = params.constants
    left = _eq.mechanical_energy(*after, p) - _eq.descent(p)
    return float(_eq.mechanical_energy(*before, p) - left)
