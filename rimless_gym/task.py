"""The walking task: what is observed, what is paid for, and where episodes start."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rimless_gym import hybrid
from rimless_gym.hybrid import DOUBLE, MAX_RATE, SINGLE
from rimless_gym.params import WheelParams
from rimless_gym.stepping import (
    DPHI,
    DTHETA,
    MODE,
    PHI,
    SOURCE_FINGERPRINT,
    STATE_SIZE,
    THETA,
)

#: Observations are (phi - pi/2) / (alpha/2), sin theta, cos theta, phi' / LEG_RATE_SCALE,
#: theta' / PENDULUM_RATE_SCALE (rad/s), and 1 while resting on two feet.
LEG_RATE_SCALE, PENDULUM_RATE_SCALE = 5.0, 10.0
OBSERVATION_SIZE = 6
OBSERVATION_BOUND = np.array(
    [1, 1, 1, MAX_RATE / LEG_RATE_SCALE, MAX_RATE / PENDULUM_RATE_SCALE, 1], dtype=np.float32
)

#: Length of an episode under the registered time limit.
EPISODE_STEPS = 2000


@dataclasses.dataclass(frozen=True)
class Task:
    """The price of distance and of an early end; every reward is in metres.

    Attributes:
        value_of_distance: reward per metre of travel; it selects the speed on the CoT front.
        fall_distance: travel forfeited when an episode ends early (m): further than a wheel gets
            in the lunge that makes it fall, so that falling for the sake of the lunge does not pay.
        horizon: whose idle energy an early end is charged (s); the time limit of the episodes.

    Raises:
        ValueError: a value is not finite or negative.
    """

    value_of_distance: float = 0.5
    fall_distance: float = 2.0
    horizon: float = EPISODE_STEPS * hybrid.CONTROL_PERIOD

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise TypeError(f"{name} = {value!r}: must be a real number")
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} = {value}: must be finite and at least 0")

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


def observe(params: WheelParams, states: NDArray[np.float64]) -> NDArray[np.float32]:
    """Observations of hybrid states (..., STATE_SIZE): a new float32 array (..., 6)."""
    observations = np.empty((*states.shape[:-1], OBSERVATION_SIZE), dtype=np.float32)
    _observe(
        states.reshape(-1, STATE_SIZE),
        params.leg_angle,
        observations.reshape(-1, OBSERVATION_SIZE),
    )
    return observations


def _observation_kernel(fingerprint: int) -> Callable[..., None]:
    @njit(error_model="numpy", cache=True)
    def observe_rows(states, alpha, observations):
        fingerprint  # noqa: B018  in numba's cache key, as in `rimless_gym.stepping`
        for x, observation in zip(states, observations):  # noqa: B905  numba knows no strict
            observation[0] = (x[PHI] - math.pi / 2) * (2 / alpha)
            observation[1] = math.sin(x[THETA])
            observation[2] = math.cos(x[THETA])
            observation[3] = x[DPHI] / LEG_RATE_SCALE
            observation[4] = x[DTHETA] / PENDULUM_RATE_SCALE
            observation[5] = x[MODE]
            for i in range(OBSERVATION_SIZE):
                bound = OBSERVATION_BOUND[i]
                observation[i] = min(max(observation[i], -bound), bound)

    return observe_rows


_observe = _observation_kernel(SOURCE_FINGERPRINT)


#: Starts: one in four at rest on two feet, the others in single stance, drawn evenly from these.
REST_SHARE = 0.25
REST_ANGLE, REST_RATE = 0.5, 1.0  # |theta| (rad), |theta'| (rad/s)
MOVING_LEG_RATE = (0.0, 2.0)  # phi' (rad/s)
MOVING_PENDULUM_RATE = 3.0  # |theta'| (rad/s), at any angle theta


def draw_start(params: WheelParams, rng: np.random.Generator) -> NDArray[np.float64]:
    """A random hybrid state (STATE_SIZE,) in which, without voltage, the feet press.

    Raises:
        RuntimeError: 1000 draws found none (the parameters hardly hold the wheel down).
    """
    p = params.constants
    for _ in range(1000):
        state = np.zeros(STATE_SIZE)
        if rng.random() < REST_SHARE:
            state[MODE], state[PHI] = DOUBLE, p.a
            state[THETA] = p.gamma + rng.uniform(-REST_ANGLE, REST_ANGLE)
            state[DTHETA] = rng.uniform(-REST_RATE, REST_RATE)
            if hybrid.both_feet_press(state[THETA], state[DTHETA], 0.0, p):
                return state
        else:
            state[MODE], state[PHI] = SINGLE, rng.uniform(p.a, p.b)
            state[THETA] = rng.uniform(-math.pi, math.pi)
            state[DPHI] = rng.uniform(*MOVING_LEG_RATE)
            state[DTHETA] = rng.uniform(-MOVING_PENDULUM_RATE, MOVING_PENDULUM_RATE)
            if normal_force(params, state) > 0.05 * params.weight:
                return state
    raise RuntimeError(
        "no start found in which the foot presses on the ground: the pendulum is too heavy or too "
        "long for this wheel, or the slope too steep; give reset(options={'state': ...})"
    )


def normal_force(params: WheelParams, state: NDArray[np.float64], voltage: float = 0.0) -> float:
    """Fy (N) on the foot, or on both feet together, of a hybrid state (STATE_SIZE,)."""
    p, x = params.constants, tuple(float(value) for value in state[:4])
    accelerations = hybrid.accelerations(int(state[MODE]), *x, voltage, p)
    return float(hybrid.ground_reaction(*x, *accelerations, p)[1])
