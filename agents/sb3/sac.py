"""SAC of stable-baselines3 in our vector environment."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.utils import polyak_update

from agents.learner import NO_CHANGES, LearnerSettings, PolicyParts, Training
from agents.prior import Prior, ReferenceStarts
from agents.rollout import Act
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.learner import Actor, NetworkPolicy, Sb3Learner
from agents.sb3.wrappers import ScaledRewards

#: With a prior, the policy is an average that follows the actor with a time constant of so many
#: roll-outs; over the first ones, it is the mean.
AVERAGED = 300


class Sac(Sb3Learner):
    """Soft actor-critic (Haarnoja et al., 2018).

    With a prior, errors of the critic turn an actor that walks into one that rests, and back,
    within a few thousand steps. So the policy is the average of the actor's weights (Polyak and
    Juditsky, 1992); the actor itself explores.
    """

    algorithm = SAC
    hyperparameter_file = "sac.yml"
    networks: ClassVar = {"pi": "actor.latent_pi.", "qf": "critic.qf0."}
    prior_wrappers = (ReferenceStarts,)

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        super().__init__(training, start)
        self._averaged = None if training.prior is None else copy.deepcopy(self.model.actor)

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> LearnerSettings:
        """The entry of `agents/hyperparams/sac.yml`.

        Raises:
            ValueError: noise is annealed, and the temperature is fixed.
        """
        settings = super().settings(init, changes)
        assert isinstance(settings, Hyperparameters)
        given = settings.algorithm
        if "noise" in settings.annealed and given.get("ent_coef", "auto") != "auto":
            raise ValueError(f"ent_coef = {given['ent_coef']}: noise needs SAC's auto; drop one")
        return settings

    def _new_model(self, described: dict[str, Any], **more: Any) -> Any:
        """A new model; with a prior, its replay buffer has the potential.

        Raises:
            ValueError: the potential cannot be added to what is sampled.
        """
        if (prior := self.training.prior) is None:
            return super()._new_model(described, **more)
        settings = self.training.settings
        assert isinstance(prior, Prior)
        assert isinstance(settings, Hyperparameters)
        if (n_steps := settings.algorithm.get("n_steps", 1)) != 1:
            raise ValueError(f"n_steps = {n_steps}: with a prior it must be 1; leave it out")
        scales = [given["scale"] for kind, given in settings.wrappers if kind is ScaledRewards]
        kwargs = {"prior": prior, "scale": math.prod(scales)}
        return super()._new_model(
            described,
            replay_buffer_class=ShapedReplayBuffer,
            replay_buffer_kwargs=kwargs,
            **more,
        )

    @property
    def _shaping(self) -> Any:
        return self.model.replay_buffer

    def _changing(self, until: int) -> list[BaseCallback]:
        """With a prior, the average too."""
        averages = [] if self._averaged is None else [AverageActor(self._averaged)]
        return [*super()._changing(until), *averages]

    @property
    def act(self) -> Act:
        """The deterministic policy as it is now."""
        if self._averaged is None:
            return super().act
        return NetworkPolicy(self._averaged, self._feedforward)

    def parts(self) -> PolicyParts:
        """The networks' architecture and weights."""
        parts = super().parts()
        if self._averaged is None:
            return parts
        actor = {name: w.numpy() for name, w in self._averaged.state_dict(prefix="actor.").items()}
        return dataclasses.replace(parts, weights=parts.weights | actor)

    def state(self) -> dict[str, Any]:
        """See `Sb3Learner.state`, and the average."""
        averaged = self._averaged and self._averaged.state_dict()
        return {**super().state(), "averaged": averaged}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        super().restore(state)
        if self._averaged is not None:
            self._averaged = copy.deepcopy(self.model.actor)
            self._averaged.load_state_dict(state["averaged"])

    @staticmethod
    def actor(model: Any) -> Actor:
        """The squashed Gaussian actor; its noise is a network's output, not a parameter."""
        actor = model.policy.actor

        def mean_action(observations: torch.Tensor) -> torch.Tensor:
            return torch.tanh(actor.mu(actor.latent_pi(observations)))[:, 0]

        def set_noise(log_std: float) -> None:
            with torch.no_grad():
                actor.log_std.weight.zero_()
                actor.log_std.bias.fill_(log_std)

        modules = actor.latent_pi, actor.mu
        weights = [weight for module in modules for weight in module.parameters()]

        def hold_noise(log_std: float) -> None:
            model.target_entropy = log_std + 0.5 * math.log(2 * math.pi * math.e)

        return Actor(model, mean_action, weights, [], set_noise, hold_noise)


class AverageActor(BaseCallback):
    """Lets a copy of the actor follow it slowly, from roll-out to roll-out."""

    def __init__(self, averaged: Any) -> None:
        super().__init__()
        self._averaged = averaged

    def _on_rollout_start(self) -> None:
        model = self.model
        assert isinstance(model, SAC)
        learned = model._n_updates / max(1, model.gradient_steps)  # roll-outs; -1: all steps
        share = 1 / min(1 + learned, AVERAGED)
        polyak_update(model.actor.parameters(), self._averaged.parameters(), share)

    def _on_step(self) -> bool:
        return True


class ShapedReplayBuffer(ReplayBuffer):
    """Adds the change of a prior's potential to the rewards when they are sampled.

    The weight of the potential changes within a training, so rewards that were shaped when they
    were stored would have an outdated weight. The potential is that of the observations, with
    their sensor noise.

    Args:
        arguments: of `ReplayBuffer`.
        prior: whose potential it is.
        scale: how many times as large as the environment's the stored rewards are.
        more: keyword arguments of `ReplayBuffer`.

    Attributes:
        weight: see `agents.prior.PotentialShaping`.
    """

    def __init__(self, *arguments: Any, prior: Prior, scale: float, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self._prior, self._scale, self.weight = prior, scale, 1.0

    def _get_samples(self, batch_inds: NDArray[np.int64], env: Any = None) -> ReplayBufferSamples:
        """Samples of these steps, with other rewards."""
        samples = super()._get_samples(batch_inds, env)
        before = self._prior.at(samples.observations.numpy())
        after = self._prior.at(samples.next_observations.numpy())
        fell = samples.dones[:, 0].numpy() > 0.5
        change = self._scale * (np.where(fell, self._prior.fallen, after) - before)
        added = torch.from_numpy(change[:, None].astype(np.float32))
        return samples._replace(rewards=samples.rewards / self.weight + added)
