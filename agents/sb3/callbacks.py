"""Callbacks of stable-baselines3 while it learns: figures of walking, the watch, frozen parts."""

from __future__ import annotations

import math

from stable_baselines3.common.callbacks import BaseCallback

from agents.learner import Watch
from agents.sb3.networks import Actor
from agents.sb3.pacing import SelfPacedPrice
from agents.sb3.training_env import ScaledReward
from agents.sb3.vec_env import Sb3VecEnv
from agents.walking_figures import WalkingFigures
from rimless_gym.params import WheelParams

#: Fewest control intervals over which logged figures are summed.
LOG_INTERVALS = 2000


class LogWalking(BaseCallback):
    """Logs the noisy walking of training: return, CoT, speed, steps and energy terms.

    Of an action that is held for several control intervals, the last one is logged.

    Args:
        params: the machine.
        env: that is learned in, innermost.
    """

    def __init__(self, params: WheelParams, env: Sb3VecEnv) -> None:
        super().__init__()
        self._figures, self._env = WalkingFigures(params), env

    def _on_step(self) -> bool:
        self._figures.add(self._env.last_info)
        return True

    def _on_rollout_end(self) -> None:
        if self._figures.intervals >= LOG_INTERVALS:
            self._figures.record(self.logger)

    def _on_training_end(self) -> None:
        if self._figures.intervals:
            self._figures.record(self.logger)
        self.logger.dump(self.num_timesteps)


class Watched(BaseCallback):
    """Lets what watches over the training act between two roll-outs, and tells it of steps."""

    def __init__(self, watch: Watch) -> None:
        super().__init__()
        self._watch = watch

    def _on_rollout_start(self) -> None:
        self._watch.between()

    def _on_step(self) -> bool:
        self._watch.advanced()
        return True


class Freeze(BaseCallback):
    """Keeps the actor as it is until the critic has learned what it is worth.

    The exploration noise stays as it is for good.

    Args:
        actor: of the model that learns.
        until: time steps before which the actor does not change.
    """

    def __init__(self, actor: Actor, until: int) -> None:
        super().__init__()
        self._actor, self._until = actor, until

    def _on_training_start(self) -> None:
        for parameter in self._actor.noise:
            parameter.requires_grad_(False)
        self._on_rollout_start()

    def _on_rollout_start(self) -> None:
        for weight in self._actor.weights:
            weight.requires_grad_(self.num_timesteps >= self._until)

    def _on_step(self) -> bool:
        return True


class InMetres(BaseCallback):
    """Pays rewards over the price of distance: so they keep their size while the price falls.

    Args:
        env: what scales the rewards.
        price: of distance.
    """

    def __init__(self, env: ScaledReward, price: SelfPacedPrice) -> None:
        super().__init__()
        self._env, self._price, self._scale = env, price, env.scale

    def _on_rollout_start(self) -> None:
        assert self._price.price is not None
        self._env.scale = self._scale / self._price.price

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._env.scale = self._scale


class Settle(BaseCallback):
    """Lets noise and learning rate fall between two counts of time steps.

    The noise falls geometrically, the learning rate linearly.

    Args:
        actor: of the model that learns.
        noise: standard deviation at first and in the end, in units of the limit.
        rates: of learning, at first and in the end.
        begun, until: the time steps.
    """

    def __init__(
        self,
        actor: Actor,
        noise: tuple[float, float],
        rates: tuple[float, float],
        begun: int,
        until: int,
    ) -> None:
        super().__init__()
        self._actor, self._noise, self._rates = actor, noise, rates
        self._begun, self._lasting = begun, max(1, until - begun)

    def _on_rollout_start(self) -> None:
        share = min(1.0, (self.num_timesteps - self._begun) / self._lasting)
        (loud, quiet), (fast, slow) = self._noise, self._rates
        self._actor.set_noise((1.0 - share) * math.log(loud) + share * math.log(quiet))
        rate = (1.0 - share) * fast + share * slow
        self.model.lr_schedule = lambda _: rate

    def _on_step(self) -> bool:
        return True
