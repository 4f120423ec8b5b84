"""What determines a trained policy."""

from __future__ import annotations

import dataclasses
from typing import Any

from agents.conditions import Conditions
from rimless_gym.envs.task import Task

#: What a training can begin from, besides a policy's file.
SCRATCH, IMITATION = "scratch", "imitation"
INITS = (SCRATCH, IMITATION)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """Hyperparameters. A learner derives its own from these.

    Attributes:
        n_timesteps: time steps of a training, unless a number is given. A step is a control
            interval, or several if the learner holds its actions for so long.
        silent: time steps at its beginning in which the learner only collects experience.
    """

    n_timesteps: int
    silent: int = 0

    @property
    def intervals_per_step(self) -> int:
        """Control intervals for which the learner holds an action."""
        return 1

    @property
    def written(self) -> dict[str, Any]:
        """Plain JSON values that tell these settings from others."""
        return dataclasses.asdict(self)


@dataclasses.dataclass(frozen=True)
class Training:
    """Everything that determines the trained policy.

    Attributes:
        algo: the learner's name.
        init: "scratch", "imitation", or a description of the policy to start from.
        seed: of everything random.
        conditions: machine, control, ranges and disturbances.
        task: the reward.
        settings: hyperparameters.
    """

    algo: str
    init: str
    seed: int
    conditions: Conditions
    task: Task
    settings: Settings

    @property
    def identity(self) -> dict[str, Any]:
        """The training as plain JSON values, by which a folder is known to hold it."""
        return {
            "algo": self.algo,
            "init": self.init,
            "seed": self.seed,
            "task": dataclasses.asdict(self.task),
            "hyperparameters": self.settings.written,
            **self.conditions.to_dict(),
        }
