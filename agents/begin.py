"""The model with which a training begins, or goes on."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from agents.checkpoint import (
    ALGORITHMS,
    CheckpointError,
    architecture,
    built,
    load_policy,
    origin,
    save_policy,
)
from agents.folder import CLONE, CLONING
from agents.hyperparameters import Hyperparameters
from agents.imitate import Cloning, clone
from agents.policies import Controller
from agents.training_env import ScaledReward, training_env
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams
from trajopt import periodic_gait
from trajopt.feedback import law

INITS = ("scratch", "imitation")

#: The gait that is imitated where no expert is given.
EXPERT_SPEED, EXPERT_STEPS = 0.5, 1


@dataclasses.dataclass(frozen=True)
class Training:
    """Everything that determines the trained policy.

    Attributes:
        algo: "ppo" or "sac".
        init: "scratch", "imitation", or the path of a policy to start from.
        seed: of everything random.
        params: the machine.
        task: the reward.
        settings: hyperparameters.
    """

    algo: str
    init: str
    seed: int
    params: WheelParams
    task: Task
    settings: Hyperparameters

    @property
    def identity(self) -> dict[str, Any]:
        """The training as plain JSON values, by which a folder is known to hold it.

        Raises:
            CheckpointError: the policy to start from cannot be read.
        """
        init = self.init if self.init in INITS else origin(self.init)
        return {
            "algo": self.algo,
            "init": init,
            "seed": self.seed,
            "params": self.params.to_dict(),
            "task": dataclasses.asdict(self.task),
            "hyperparameters": self.settings.written,
        }

    def env(self) -> ScaledReward:
        """Environments to learn in."""
        settings = self.settings
        return training_env(
            settings.n_envs, self.params, self.task, self.seed, settings.reward_scale
        )

    def model(self, env: ScaledReward, policy_kwargs: dict[str, Any] | None = None) -> Any:
        """A new model with the networks of the hyperparameters, or of `policy_kwargs` if given."""
        arguments = {"env": env, "seed": self.seed, **self.settings.algorithm}
        if policy_kwargs is None:
            return ALGORITHMS[self.algo](device="cpu", **arguments)
        return built(self.algo, **arguments | {"policy_kwargs": policy_kwargs})


def started_from(training: Training, env: ScaledReward) -> Any:
    """A new model with the policy of a file: its own optimiser, schedule and seed.

    Raises:
        CheckpointError: the file is missing, damaged, or for another machine or algorithm.
    """
    start = load_policy(training.init, training.params)
    if start.algo != training.algo:
        raise CheckpointError(
            f"{training.init}: a {start.algo} policy cannot start {training.algo}; use one of "
            f"{training.algo}"
        )
    model = training.model(env, architecture(start.model))
    model.policy.load_state_dict(start.model.policy.state_dict())
    return model


def cloned(
    training: Training,
    env: ScaledReward,
    out: Path,
    expert: Controller | None,
    cloning: Cloning | None,
    progress: bool,
) -> Any:
    """A new model whose actor imitates `expert`, which is also kept as clone.zip in `out`."""
    params = training.params
    model = training.model(env)
    if expert is None:
        expert = law("lqr")(periodic_gait(params, EXPERT_SPEED, EXPERT_STEPS, progress=progress))
    kept = out / CLONING
    report = clone(model, expert, params, cloning, seed=training.seed, kept=kept, progress=progress)
    notes = {"cloning": dataclasses.asdict(report)}
    save_policy(out / CLONE, model, params, training.task, training.seed, **notes)
    return model
