"""Policies of stable-baselines3 that are linear in the products of `agents.evolution.policy`."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents.evolution.policy import SIZE, features
from trajopt.feedback.law import Floats

#: A direction in which the products hardly vary is stretched as though its mean square were larger
#: by this. docs/learning.md has trials with more and with less.
FLOOR = 0.003


class Products(BaseFeaturesExtractor):
    """The products, mixed so that gradients are natural ones.

    Along a gait the products are nearly dependent: in some directions of their space they vary
    a hundred times as much as in others, and a gradient sees only the first. `whiten` mixes them so
    that all directions count alike. For a linear policy with constant noise, gradients then are
    the natural ones (Kakade, A natural policy gradient, 2001).

    Args:
        space: of the observations, six numbers each.
    """

    mixing: torch.Tensor

    def __init__(self, space: Any) -> None:
        super().__init__(space, SIZE)
        self.register_buffer("mixing", torch.eye(SIZE))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """The mixed products (N, SIZE) of observations (N, 6)."""
        return _products(observations) @ self.mixing

    def whiten(self, observations: NDArray[np.float32]) -> None:
        """Mix the products so that they vary alike over some observations (N, 6)."""
        found = _products(torch.from_numpy(observations)).numpy().astype(np.float64)
        variances, directions = np.linalg.eigh(found.T @ found / len(found))
        mixing = (directions / np.sqrt(variances + FLOOR)) @ directions.T
        self.mixing.copy_(torch.from_numpy(mixing))


def _products(observations: torch.Tensor) -> torch.Tensor:
    constant, *others = features(*observations.unbind(1))
    return torch.stack([torch.full_like(others[0], constant), *others], dim=1)


def put_policy(network: Any, weights: Floats) -> None:
    """Let a stable-baselines3 policy with `Products` act by weights (SIZE,) of the products."""
    mixing = network.features_extractor.mixing.double()
    with torch.no_grad():
        network.action_net.bias.zero_()
        network.action_net.weight[0] = torch.linalg.solve(mixing, torch.from_numpy(weights))


def policy_of(network: Any) -> Floats:
    """The weights (SIZE,) of the products by which a stable-baselines3 policy acts."""
    layer, mixing = network.action_net, network.features_extractor.mixing
    weights = mixing.numpy() @ layer.weight.detach().numpy()[0].astype(np.float64)
    weights[0] += layer.bias.item()  # the constant product comes first
    return np.asarray(weights)
