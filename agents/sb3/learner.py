"""What all learners built on stable-baselines3 share; each adds its algorithm and its actor."""

from __future__ import annotations

import functools
import inspect
from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import torch
from stable_baselines3.common.callbacks import BaseCallback

from agents.conditions import Conditions
from agents.imitation import CloneReport, Cloning, Teaching
from agents.learner import NO_CHANGES, Learner, PolicyParts, Watch, require_known
from agents.policies import Act, Policy
from agents.sb3.advice import advice
from agents.sb3.bounds import NOT_OURS, require_possible
from agents.sb3.callbacks import Freeze, LogWalking, Watched
from agents.sb3.cloning import clone
from agents.sb3.hyperparameters import ENVIRONMENTS, Hyperparameters, hyperparameters
from agents.sb3.layers import layer_of
from agents.sb3.networks import (
    Actor,
    NetworkPolicy,
    architecture,
    policy_kwargs,
    put_weights,
    weights_of,
)
from agents.sb3.pacing import SelfPacedPrice
from agents.sb3.state import restore, state_of
from agents.sb3.training_env import training_env
from agents.sb3.vec_env import Sb3VecEnv
from agents.training import SCRATCH, Settings, Training
from rimless_gym.checks import flag, integer, real
from rimless_gym.envs.task import Task

#: Share of a fine-tuning in which only the critic learns.
CRITIC_WARM_UP = 0.15


#: How arguments of one plain type are checked: stable-baselines3 takes any, and fails later. It
#: writes -1 where a number follows from others.
PLAIN: dict[Any, Callable[[str, Any], Any]] = {
    int: functools.partial(integer, least=-1),
    float: real,
    bool: flag,
}


class Sb3Learner(Learner):
    """An algorithm of stable-baselines3 in our vector environment.

    torch runs on one thread: sums depend on how they are split among threads, and these networks
    are too small to gain from more.

    Attributes:
        algorithm: of stable-baselines3.
        hyperparameter_file: name of its file in `agents/hyperparams`.
        model: that learns.

    Raises:
        TypeError: the training's settings are not `Hyperparameters`.
    """

    imitates = True
    algorithm: ClassVar[Any]
    hyperparameter_file: ClassVar[str]

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        torch.set_num_threads(1)
        settings = training.settings
        if not isinstance(settings, Hyperparameters):
            raise TypeError(f"settings = {settings!r}: must be agents.sb3 Hyperparameters")
        self.training = training
        self._arguments = settings.algorithm
        self._env = training_env(
            settings.n_envs,
            training.conditions,
            training.task,
            training.seed,
            settings.offer,
        )
        self._price = None if settings.pacing is None else SelfPacedPrice(settings.pacing)
        if start is None:
            self.model = self._new_model({})
        else:
            self.model = self._new_model(start.record)
            put_weights(self.model, start.weights)

    def _new_model(self, described: dict[str, Any]) -> Any:
        """A new model with the networks of the hyperparameters, or those that are described."""
        arguments = {"env": self._env, "seed": self.training.seed, **self._arguments}
        if "policy_kwargs" in described:
            arguments["policy_kwargs"] = policy_kwargs(described["policy_kwargs"])
        try:
            return self.algorithm(device="cpu", **arguments)
        except Exception as error:  # stable-baselines3 refuses arguments in many ways
            raise ValueError(f"{error!r}, with the hyperparameters {self._arguments}") from error

    @staticmethod
    @abstractmethod
    def actor(model: Any) -> Actor:
        """The part of a model of this algorithm that chooses actions."""

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> Settings:
        """The entry of the algorithm's file in `agents/hyperparams`, as rl-zoo3 writes it."""
        taken = inspect.signature(cls.algorithm).parameters
        require_known(changes, [*ENVIRONMENTS, *(name for name in taken if name not in NOT_OURS)])
        found = hyperparameters(cls.hyperparameter_file, init != SCRATCH, changes)
        for name, value in found.algorithm.items():
            if name in taken and taken[name].annotation in PLAIN:
                PLAIN[taken[name].annotation](name, value)
        require_possible(found.algorithm)
        return found

    @classmethod
    def advice(cls, training: Training) -> list[str]:
        """See `agents.sb3.advice`."""
        settings = training.settings
        return advice(training, settings) if isinstance(settings, Hyperparameters) else []

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy in `parts`; its model has stable-baselines3's default settings."""
        torch.set_num_threads(1)
        model = cls.algorithm(
            policy="MlpPolicy",
            env=training_env(1, conditions, task, seed=0),
            device="cpu",
            policy_kwargs=policy_kwargs(parts.record["policy_kwargs"]),
        )
        put_weights(model, parts.weights)
        model.num_timesteps = int(parts.record["timesteps"])
        model.policy.set_training_mode(False)
        return NetworkPolicy(model)

    @property
    def steps(self) -> int:
        """Time steps so far, all environments together."""
        return int(self.model.num_timesteps)

    @property
    def act(self) -> Act:
        """The deterministic policy as it is now."""
        return NetworkPolicy(self.model)

    def imitate(self, expert: Policy, cloning: Cloning, kept: Path, progress: bool) -> CloneReport:
        """Clone the expert into the actor."""
        teaching = Teaching(expert, self.training.conditions, cloning, self.training.seed)
        return clone(self.actor(self.model), teaching, kept=kept, progress=progress)

    def learn(self, until: int, watch: Watch) -> None:
        """Learn until there have been `until` steps; a roll-out that was begun is ended.

        Where there is a policy to start from, its actor stays as it is for a while.
        """
        model = self.model
        model.set_logger(watch.log)
        log = LogWalking(self.training.conditions.params, layer_of(self._env, Sb3VecEnv))
        callbacks: list[BaseCallback] = [log, Watched(watch)]
        if self._price is not None:
            callbacks.append(self._price)
        if self.training.init != SCRATCH:
            callbacks.append(Freeze(self.actor(model), round(CRITIC_WARM_UP * until)))
        model.learn(max(0, until - self.steps), callbacks, reset_num_timesteps=False)

    def parts(self) -> PolicyParts:
        """The networks' architecture and weights."""
        return PolicyParts({"policy_kwargs": architecture(self.model)}, weights_of(self.model))

    def state(self) -> dict[str, Any]:
        """Model, environments and all random generators, between two roll-outs."""
        price = None if self._price is None else self._price.state()
        return {"policy_kwargs": architecture(self.model), "price": price, **state_of(self.model)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        if state["policy_kwargs"] != architecture(self.model):
            self.model = self._new_model(state)
        restore(self.model, state)
        if self._price is not None:
            self._price.restore(state["price"])

    def close(self) -> None:
        """Close the environments."""
        self._env.close()
