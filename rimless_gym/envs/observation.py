"""What is observed of a hybrid state."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rimless_gym.envs.layout import MEMORY
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, PHI, STATE_SIZE, THETA
from rimless_gym.params import WheelParams
from rimless_gym.trigonometry import cos, sin

#: Observations are (phi - pi/2) / (alpha/2), sin theta, cos theta, phi' / LEG_RATE_SCALE,
#: theta' / PENDULUM_RATE_SCALE (rad/s), and 1 while resting on two feet.
LEG_RATE_SCALE, PENDULUM_RATE_SCALE = 5.0, 10.0
OBSERVATION_SIZE = 6
OBSERVATION_BOUND = np.array(
    [1, 1, 1, MAX_RATE / LEG_RATE_SCALE, MAX_RATE / PENDULUM_RATE_SCALE, 1], dtype=np.float32
)

#: With a commanded speed, two numbers follow: (speed - MIDDLE_SPEED) / SPEED_SCALE (m/s), and the
#: credit in units of its limit; see `rimless_gym.envs.task.Task`.
MIDDLE_SPEED, SPEED_SCALE = 0.45, 0.2
COMMANDED_SIZE = OBSERVATION_SIZE + 2
MOST_SPEED = 2.0  # m/s, that may be commanded
COMMANDED_BOUND = np.append(
    OBSERVATION_BOUND, np.array([(MOST_SPEED - MIDDLE_SPEED) / SPEED_SCALE, 1], dtype=np.float32)
)

#: Sensor errors of phi, theta, phi', theta' without noise.
NO_ERRORS = (0.0, 0.0, 0.0, 0.0)

_PLAIN = np.uint64(OBSERVATION_SIZE)


@inner
def observation(phi, theta, dphi, dtheta, mode, leg_scale):
    """The observation's six numbers; `leg_scale` is 2 / alpha."""
    return (
        _within((phi - math.pi / 2) * leg_scale, 1.0),
        sin(theta),
        cos(theta),
        _within(dphi / LEG_RATE_SCALE, MAX_RATE / LEG_RATE_SCALE),
        _within(dtheta / PENDULUM_RATE_SCALE, MAX_RATE / PENDULUM_RATE_SCALE),
        mode,
    )


@inner
def _within(value, bound):
    return min(max(value, -bound), bound)


@inner
def observe_row(memory, errors, observations, width, i):
    """Write the observation of row i; `observations` is flat, `width` (uint64) numbers per row.

    With a width of COMMANDED_SIZE, the command is observed too, and always exactly.
    """
    values = observation(
        memory[MEMORY.phi, i] + errors[0],
        memory[MEMORY.theta, i] + errors[1],
        memory[MEMORY.dphi, i] + errors[2],
        memory[MEMORY.dtheta, i] + errors[3],
        memory[MEMORY.mode, i],
        memory[MEMORY.leg_scale, i],
    )
    for k in range(OBSERVATION_SIZE):
        observations[i * width + np.uint64(k)] = values[k]
    if width > _PLAIN:
        speed = memory[MEMORY.target_speed, i]
        credit = memory[MEMORY.credit, i] / memory[MEMORY.credit_limit, i]
        observations[i * width + _PLAIN] = (speed - MIDDLE_SPEED) / SPEED_SCALE
        observations[i * width + _PLAIN + np.uint64(1)] = credit


def observe(params: WheelParams, states: NDArray[np.float64]) -> NDArray[np.float32]:
    """Observations of hybrid states (..., STATE_SIZE): a new float32 array (..., 6)."""
    observations = np.empty((*states.shape[:-1], OBSERVATION_SIZE), dtype=np.float32)
    _observe(
        states.reshape(-1, STATE_SIZE),
        2 / params.leg_angle,
        observations.reshape(-1, OBSERVATION_SIZE),
    )
    return observations


@cached()
def _observe(states, leg_scale, observations):
    for x, seen in zip(states, observations):  # noqa: B905  numba knows no strict
        values = observation(x[PHI], x[THETA], x[DPHI], x[DTHETA], x[MODE], leg_scale)
        for i in range(OBSERVATION_SIZE):
            seen[i] = values[i]
