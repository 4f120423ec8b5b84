"""Back-EMF feedforward: policies whose actions are deviations from the back-EMF.

The back-EMF is the voltage at which no current flows and the pendulum swings freely. A network that
commands voltages has to learn it, to a hundredth of the limit, before it can save energy.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.learner import PolicyParts
from agents.sb3.vec_env import Sb3VecEnv
from agents.sb3.wrappers import wrapped
from rimless_gym.checks import positive
from rimless_gym.envs.layout import LEG_RATE_SCALE, PENDULUM_RATE_SCALE
from rimless_gym.hybrid import motor_voltage, relative_rate
from rimless_gym.params import WheelParams

#: The rates in an observation, of the legs and the pendulum.
RATES = slice(3, 5)

#: A tanh of this times a share of the voltage limit is nearly linear.
NEARLY_LINEAR = 0.1

#: The entry of a policy's record that scales its deviations from the back-EMF, if it has them.
SCALE = "back_emf_scale"


@dataclasses.dataclass(frozen=True)
class Feedforward:
    """Voltages for actions that are deviations from the back-EMF.

    Attributes:
        params: the machine whose back-EMF it is, whichever walks.
        scale: the deviation for an action of 1, in voltage limits.
    """

    params: WheelParams
    scale: float

    def voltages(self, actions: NDArray[Any], observations: NDArray[np.float32]) -> NDArray[Any]:
        """Voltages (N, 1) in voltage limits, for actions (N, 1) and observations (N, 6 or 8)."""
        back_emf = observations[:, RATES] @ back_emf_gains(self.params)
        return np.asarray(np.clip(back_emf[:, None] + self.scale * actions, -1.0, 1.0))


class BackEmfFeedforward(VecEnvWrapper):
    """Actions are deviations from the back-EMF; see `Feedforward`.

    It belongs below `HeldActions`: so a deviation is held, and the back-EMF renewed in every
    control interval.

    Args:
        venv: environments.
        scale: the deviation for an action of 1, in voltage limits.
    """

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        # no machine is drawn yet: this is the nominal one
        self._native = wrapped(venv, Sb3VecEnv).native
        self._feedforward = Feedforward(self._native.params[0], positive("scale", scale))

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Begin a step with these deviations."""
        self.venv.step_async(self._feedforward.voltages(actions, self._native.observations))

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments return."""
        return self.venv.step_wait()


def commanding_voltages(parts: PolicyParts, feedforward: Feedforward) -> PolicyParts:
    """PPO's policy whose network commands voltages instead of deviations from the back-EMF.

    One more unit of each hidden layer, of tanh, passes the back-EMF on: at the voltage limit it is
    0.7 % too small, at a third of it 0.07 %. The network's own output is no longer limited to 1.
    """
    record, weights = dict(parts.record), dict(parts.weights)
    scale, kwargs = record.pop(SCALE), record["policy_kwargs"]
    units: list[int] = []
    while (name := f"mlp_extractor.policy_net.{2 * len(units)}.weight") in weights:
        if units:
            matrix = np.pad(weights[name], ((0, 1), (0, 1)))
            matrix[-1, -1] = 1.0
        else:
            matrix = np.pad(weights[name], ((0, 1), (0, 0)))
            matrix[-1, RATES] = NEARLY_LINEAR * back_emf_gains(feedforward.params)
        bias = name.replace("weight", "bias")
        weights |= {name: matrix, bias: np.pad(weights[bias], (0, 1))}
        units.append(len(matrix))
    if not units or kwargs.get("activation_fn", "Tanh") != "Tanh":
        raise ValueError(
            f"policy_kwargs = {kwargs}: with BackEmfFeedforward, PPO needs hidden layers of Tanh"
        )
    last = np.pad(scale * weights["action_net.weight"], ((0, 0), (0, 1)))
    last[0, -1] = 1.0 / NEARLY_LINEAR
    weights |= {"action_net.weight": last, "action_net.bias": scale * weights["action_net.bias"]}
    values = "mlp_extractor.value_net."
    critic = [len(w) for n, w in weights.items() if n.startswith(values) and w.ndim == 2]
    described = {**kwargs, "net_arch": {"pi": units, "vf": critic}}
    return PolicyParts({**record, "policy_kwargs": described}, weights)


def back_emf_gains(params: WheelParams) -> NDArray[np.float32]:
    """The back-EMF, in voltage limits, for rates of 1 in an observation, of legs and pendulum."""
    p = params.constants
    rates = relative_rate(LEG_RATE_SCALE, 0.0, p), relative_rate(0.0, PENDULUM_RATE_SCALE, p)
    volts = [motor_voltage(rate, 0.0, p) for rate in rates]
    return np.array(volts, dtype=np.float32) / np.float32(params.voltage_limit)
