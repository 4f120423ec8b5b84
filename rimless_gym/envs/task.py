"""The walking task: what is observed, what is paid for, and where episodes start."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from rimless_gym import hybrid
from rimless_gym.checks import not_negative
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.randomness import between, next_uniform
from rimless_gym.hybrid import DOUBLE, MAX_RATE, SINGLE
from rimless_gym.jit import inner, kept
from rimless_gym.kernel.stepping import (
    DPHI,
    DTHETA,
    MODE,
    PHI,
    STATE_SIZE,
    THETA,
)
from rimless_gym.params import N_CONSTANTS, Constants, WheelParams
from rimless_gym.trigonometry import cos, sin

#: Observations are (phi - pi/2) / (alpha/2), sin theta, cos theta, phi' / LEG_RATE_SCALE,
#: theta' / PENDULUM_RATE_SCALE (rad/s), and 1 while resting on two feet.
LEG_RATE_SCALE, PENDULUM_RATE_SCALE = 5.0, 10.0
OBSERVATION_SIZE = 6
OBSERVATION_BOUND = np.array(
    [1, 1, 1, MAX_RATE / LEG_RATE_SCALE, MAX_RATE / PENDULUM_RATE_SCALE, 1], dtype=np.float32
)


@dataclasses.dataclass(frozen=True)
class Task:
    """The price of distance and of an early end; every reward is in metres.

    Attributes:
        value_of_distance: reward per metre of travel; it selects the speed on the CoT front.
        fall_distance: travel forfeited when an episode ends early (m): further than a wheel gets
            in the lunge that makes it fall, so that falling for the sake of the lunge does not pay.
        horizon: whose idle energy an early end is charged (s); the time limit of the episodes.

    Raises:
        TypeError: a value is not a number.
        ValueError: a value is negative, not finite or larger than 1e30.
    """

    value_of_distance: float = 0.5
    fall_distance: float = 2.0
    horizon: float = EPISODE_STEPS * hybrid.CONTROL_PERIOD

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            object.__setattr__(self, name, not_negative(name, value))

    def reward_terms(
        self, params: WheelParams, distance: Any, energy: Any, failed: Any
    ) -> tuple[Any, Any, Any]:
        """Reward for distance (m), for energy E+ (J), and for an early end; their sum is r.

        Resting costs idle power only, and an early end is charged a whole `horizon` of it on top
        of the travel forfeited: where the wheel can rest, ending early is never better than
        resting. Numbers or arrays.
        """
        end = self.value_of_distance * self.fall_distance
        end += params.idle_power * self.horizon / params.weight
        return self.value_of_distance * distance, -energy / params.weight, -end * failed


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


def observe(params: WheelParams, states: NDArray[np.float64]) -> NDArray[np.float32]:
    """Observations of hybrid states (..., STATE_SIZE): a new float32 array (..., 6)."""
    observations = np.empty((*states.shape[:-1], OBSERVATION_SIZE), dtype=np.float32)
    _observe(
        states.reshape(-1, STATE_SIZE),
        2 / params.leg_angle,
        observations.reshape(-1, OBSERVATION_SIZE),
    )
    return observations


@kept()
def _observe(states, leg_scale, observations):
    for x, seen in zip(states, observations):  # noqa: B905  numba knows no strict
        values = observation(x[PHI], x[THETA], x[DPHI], x[DTHETA], x[MODE], leg_scale)
        for i in range(OBSERVATION_SIZE):
            seen[i] = values[i]


#: Starts: one in four at rest on two feet, the others in single stance, drawn evenly from these.
REST_SHARE = 0.25
REST_ANGLE, REST_RATE = 0.5, 1.0  # |theta| from hanging (rad), |theta'| (rad/s)
MOVING_LEG_RATE = (0.0, 2.0)  # phi' (rad/s)
MOVING_PENDULUM_RATE = 3.0  # |theta'| (rad/s), at any angle theta
LEAST_FORCE = 0.05  # of the foot on the ground, in weights, where the wheel moves
DRAWS = 1000  # before giving up

NO_START = (
    "no start found in which the foot presses on the ground: the pendulum is too heavy or too "
    "long for this wheel, or the slope too steep; give reset(options={'state': ...})"
)


@inner
def foot_force(mode, phi, theta, dphi, dtheta, voltage, p):
    """Fy (N) on the foot, or on both feet together."""
    ddphi, ddtheta = hybrid.accelerations(mode, phi, theta, dphi, dtheta, voltage, p)
    return hybrid.ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p)[1]


@inner
def draw_state(slope, weight, p, streams, i):
    """A random start from stream i: (found, mode, phi, theta, phi', theta')."""
    for _ in range(DRAWS):
        if next_uniform(streams, i) < REST_SHARE:
            theta = slope + between(-REST_ANGLE, REST_ANGLE, streams, i)
            dtheta = between(-REST_RATE, REST_RATE, streams, i)
            if hybrid.both_feet_press(theta, dtheta, 0.0, p):
                return True, DOUBLE, p.a, theta, 0.0, dtheta
        else:
            phi = between(p.a, p.b, streams, i)
            theta = between(-math.pi, math.pi, streams, i)
            dphi = between(MOVING_LEG_RATE[0], MOVING_LEG_RATE[1], streams, i)
            dtheta = between(-MOVING_PENDULUM_RATE, MOVING_PENDULUM_RATE, streams, i)
            if foot_force(float(SINGLE), phi, theta, dphi, dtheta, 0.0, p) > LEAST_FORCE * weight:
                return True, SINGLE, phi, theta, dphi, dtheta
    return False, SINGLE, p.a, 0.0, 0.0, 0.0


def draw_start(params: WheelParams, rng: np.random.Generator) -> NDArray[np.float64]:
    """A random hybrid state (STATE_SIZE,) in which, without voltage, the feet press.

    It takes one 64-bit number from `rng`, and is the start of the environment whose generator
    that is.

    Raises:
        RuntimeError: 1000 draws found none (the parameters hardly hold the wheel down).
    """
    streams = np.array([rng.bit_generator.random_raw()], dtype=np.uint64)
    state = np.zeros(STATE_SIZE)
    if not _draw(params.constants_array, params.slope, params.weight, streams, state):
        raise RuntimeError(NO_START)
    return state


@kept()
def _draw(constants, slope, weight, streams, state):
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    found, state[MODE], state[PHI], state[THETA], state[DPHI], state[DTHETA] = draw_state(
        slope, weight, p, streams, 0
    )
    return found


@inner
def greatest_force(mode, phi, theta, dphi, dtheta, limit, p):
    """The largest Fy (N) that a voltage from -limit to limit gives; it is affine in the voltage."""
    return max(
        foot_force(mode, phi, theta, dphi, dtheta, -limit, p),
        foot_force(mode, phi, theta, dphi, dtheta, limit, p),
    )


def normal_force(params: WheelParams, state: NDArray[np.float64], limit: float = 0.0) -> float:
    """The largest Fy (N) that a voltage from -limit to limit gives in a state (STATE_SIZE,)."""
    return _force(params.constants_array, state, limit)


@kept()
def _force(constants, x, limit):
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return greatest_force(x[MODE], x[PHI], x[THETA], x[DPHI], x[DTHETA], limit, p)
