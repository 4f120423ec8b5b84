"""What a policy is here, and how learned models and model-based controllers become one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rimless_gym.kernel.stepping import MODE
from rimless_gym.params import WheelParams

Floats: TypeAlias = NDArray[np.float64]

#: (states (N, 6), observations (N, 6)) -> voltage in units of the limit, (N,). Observations are
#: what a learner may use; states are there for model-based controllers.
Policy: TypeAlias = Callable[[Floats, NDArray[np.float32]], Floats]

#: (x (N, 4), mode (N,)) -> V (N,): a feedback law on phi, theta, phi', theta' and stance mode.
Controller: TypeAlias = Callable[[Floats, NDArray[np.int64]], Floats]


def model_policy(model: Any) -> Policy:
    """The deterministic policy of a stable-baselines3 `model`."""

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        actions, _ = model.predict(observations, deterministic=True)
        return actions[:, 0].astype(np.float64)

    return policy


def controller_policy(params: WheelParams, controller: Controller) -> Policy:
    """A feedback law in volts as a policy, clipped to the limit of `params`."""

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        volts = controller(states[:, :4], states[:, MODE].astype(np.int64))
        return np.clip(np.asarray(volts, dtype=np.float64) / params.voltage_limit, -1.0, 1.0)

    return policy
