"""PPO (Schulman et al., 2017) of stable-baselines3."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3 import PPO

from agents.sb3.learner import Sb3Learner
from agents.sb3.networks import Actor


class Learner(Sb3Learner):
    """Proximal policy optimisation."""

    algorithm = PPO
    hyperparameter_file = "ppo.yml"

    @staticmethod
    def actor(model: Any) -> Actor:
        """The Gaussian actor; its noise is the same in all states."""
        policy = model.policy

        def mean_action(observations: torch.Tensor) -> torch.Tensor:
            latent = policy.mlp_extractor.forward_actor(observations)
            return policy.action_net(latent)[:, 0]

        def set_noise(log_std: float) -> None:
            with torch.no_grad():
                policy.log_std.fill_(log_std)

        modules = policy.mlp_extractor.policy_net, policy.action_net
        weights = [weight for module in modules for weight in module.parameters()]
        return Actor(model, mean_action, weights, [policy.log_std], set_noise)
