"""A charge for steps backward, which keep a walk from getting cheaper.

A wheel that comes out of a touchdown too slowly rocks back onto the leg behind, and then forward
again. Both touchdowns lose energy. Some gaits have such a step back in every stride, and policies
stay in them: whoever stops rocking a little earlier gains little. A charge makes it worth their
while.
"""

from __future__ import annotations

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.sb3.layers import layer_of
from agents.sb3.setting_off import SettingOff
from rimless_gym.checks import not_negative


class SteppingBack(VecEnvWrapper):
    """Charges every touchdown that is a step backward, once a wheel has set off.

    Whoever leaves double stance backward, which takes no touchdown, pays half.

    Args:
        venv: environments with a `SettingOff`. What monitors them below is not changed.
        charge: for each step backward (m), as the energy that lifts the wheel so far.

    Attributes:
        charge: as given; it may be changed at any time.

    Raises:
        TypeError: the charge is not a number, or there is no `SettingOff`.
        ValueError: it is negative.
    """

    def __init__(self, venv: VecEnv, charge: float = 0.0) -> None:
        super().__init__(venv)
        self.charge = not_negative("charge", charge)
        self._setting_off = layer_of(venv, SettingOff)

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments give, the rewards less the charges."""
        walking = ~self._setting_off.setting_off
        observations, rewards, dones, infos = self.venv.step_wait()
        if self.charge > 0.0:
            info = self._setting_off.native.last_info
            back = (info["touchdowns"] - info["steps"]) / 2  # `steps` counts them as -1
            rewards = (rewards - self.charge * walking * back).astype(np.float32)
        return observations, rewards, dones, infos
