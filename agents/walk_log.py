"""A walk in the environment as the sensors of a wheel would log it."""

from __future__ import annotations

import numpy as np

from agents.conditions import Conditions
from agents.rollout import Policy, Rollout
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.law import Floats
from trajopt.identification import Log, Noise


def recorded(
    policy: Policy,
    params: WheelParams,
    start: Floats,
    seconds: float,
    noise: Noise | None = None,
    seed: int = 0,
) -> Log:
    """The log of a policy's walk until it falls, `seconds` long at most.

    Args:
        policy: see `agents.rollout`; it is given the true state.
        params: the machine that walks.
        start: hybrid state (STATE_SIZE,).
        seconds: to log.
        noise: standard deviations of the sensors' errors, which are normally distributed.
        seed: of the errors.

    Raises:
        ValueError: see `agents.rollout.Rollout`.
    """
    noise = noise or Noise()
    walk = Rollout(Conditions(params), policy, start[None], round(seconds / CONTROL_PERIOD))
    intervals = list(walk)
    states = np.concatenate([each.states for each in intervals])
    volts = params.voltage_limit * np.concatenate([each.actions for each in intervals])
    current = HybridModel(params).functions["motor_current"].map(len(volts))
    columns = np.vstack([states[:, :4].T, current(states[:, :4].T, volts[None]).full()])
    sd = np.array([noise.angle, noise.angle, noise.rate, noise.rate, noise.current])
    errors = np.random.default_rng(seed).standard_normal(columns.shape)
    phi, theta, dphi, dtheta, amps = columns + sd[:, None] * errors
    time = np.asarray(CONTROL_PERIOD * np.arange(len(volts)), dtype=np.float64)
    return Log(time, phi, theta, states[:, FOOT], states[:, MODE], volts, amps, dphi, dtheta)
