"""SAC (Haarnoja et al., 2018) of stable-baselines3."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3 import SAC

from agents.sb3.learner import Sb3Learner
from agents.sb3.networks import Actor


class Learner(Sb3Learner):
    """Soft actor-critic."""

    algorithm = SAC
    hyperparameter_file = "sac.yml"

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
        return Actor(model, mean_action, weights, [], set_noise)
