"""The walking task: what is observed, what is paid for, and where episodes start."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rimless_gym import hybrid
from rimless_gym.hybrid import DOUBLE, MAX_RATE, SINGLE
from rimless_gym.params import WheelParams
from rimless_gym.stepping import DPHI, DTHETA, MODE, PHI, STATE_SIZE, THETA

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
    """The price of distance and of falling; every reward is in metres.

    Attributes:
        value_of_distance: reward per metre of travel; it selects the speed on the CoT front.
        fall_cost: charged when an episode ends early, >= 0; an episode's idle energy on top.

    Raises:
        ValueError: a value is not finite or negative.
    """

    value_of_distance: float = 0.5
    fall_cost: float = 1.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} = {value}: must be finite and at least 0")

    def reward_terms(
        self, params: WheelParams, distance: Any, energy: Any, failed: Any
    ) -> tuple[Any, Any, Any]:
        """Reward for distance (m), for energy E+ (J), and for an early end; their sum is r.

        Resting costs idle power only, and an early end is charged a whole episode of it and
        `fall_cost`: ending early is never better than resting. Numbers or arrays.
        """
        horizon = EPISODE_STEPS * hybrid.CONTROL_PERIOD
        end = self.fall_cost + params.idle_power * horizon / params.weight
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


@njit(error_model="numpy", cache=True)
def _observe(states, alpha, observations):
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
