"""Callbacks of stable-baselines3 while it learns: figures of walking, the watch, frozen parts."""

from __future__ import annotations

from stable_baselines3.common.callbacks import BaseCallback

from agents.learner import Watch
from agents.sb3.networks import Actor
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
