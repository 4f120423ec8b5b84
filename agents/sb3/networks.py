"""The networks of stable-baselines3's models: described by plain values, built, and run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.sb3.hyperparameters import ACTIVATIONS
from trajopt.feedback.law import Floats
from trajopt.files import jsonable


@dataclasses.dataclass(frozen=True)
class NetworkPolicy:
    """The deterministic policy of a stable-baselines3 `model`: observations -> actions."""

    model: Any

    def __call__(self, observations: NDArray[np.float32]) -> Floats:
        """Actions (N,) in [-1, 1] for observations (N, 6)."""
        actions, _ = self.model.predict(observations, deterministic=True)
        return np.asarray(actions[:, 0], dtype=np.float64)


@dataclasses.dataclass(frozen=True)
class Actor:
    """The part of a stable-baselines3 model that chooses actions.

    Attributes:
        model: to which it belongs.
        mean_action: the deterministic action (N,) as a differentiable function of observations.
        weights: of that function.
        noise: parameters of the exploration noise that learning changes by themselves.
        set_noise: gives the noise this natural logarithm of its standard deviation in all states.
    """

    model: Any
    mean_action: Callable[[torch.Tensor], torch.Tensor]
    weights: list[nn.Parameter]
    noise: list[nn.Parameter]
    set_noise: Callable[[float], None]

    @property
    def act(self) -> NetworkPolicy:
        """The deterministic policy, for NumPy arrays."""
        return NetworkPolicy(self.model)


def architecture(model: Any) -> dict[str, Any]:
    """The `policy_kwargs` of a model as JSON values, the activation by its name.

    Raises:
        ValueError: they hold something that JSON cannot, or the policy is not an MlpPolicy.
    """
    if type(model.policy) is not type(model).policy_aliases["MlpPolicy"]:
        raise ValueError(
            f"policy = {type(model.policy).__name__}: only an MlpPolicy is kept in a policy file"
        )
    named = {kind: name for name, kind in ACTIVATIONS.items()}
    kwargs = dict(model.policy_kwargs)
    # SAC adds this one by itself.
    kwargs = {k: v for k, v in kwargs.items() if not (k == "use_sde" and v is False)}
    activation = kwargs.get("activation_fn")
    if activation is not None:
        if activation not in named:
            raise ValueError(f"activation_fn = {activation}: choose from {list(ACTIVATIONS)}")
        kwargs["activation_fn"] = named[activation]
    wrong = [k for k, v in kwargs.items() if not _is_plain(v)]
    if wrong:
        raise ValueError(f"policy_kwargs {wrong}: only plain values are kept in a policy file")
    return dict(jsonable(kwargs))


def _is_plain(value: Any) -> bool:
    if isinstance(value, dict):
        return all(isinstance(key, str) and _is_plain(item) for key, item in value.items())
    if isinstance(value, list | tuple):
        return all(_is_plain(item) for item in value)
    return value is None or isinstance(value, bool | int | float | str)


def policy_kwargs(described: Mapping[str, Any]) -> dict[str, Any]:
    """The `policy_kwargs` that `architecture` described.

    Raises:
        KeyError: there is no such activation.
    """
    kwargs = dict(described)
    if "activation_fn" in kwargs:
        kwargs["activation_fn"] = ACTIVATIONS[kwargs["activation_fn"]]
    return kwargs


def weights_of(model: Any) -> dict[str, NDArray[Any]]:
    """The weights of a model's networks by name."""
    return {name: w.detach().cpu().numpy() for name, w in model.policy.state_dict().items()}


def put_weights(model: Any, weights: Mapping[str, NDArray[Any]]) -> None:
    """Give a model's networks the weights that `weights_of` named.

    Raises:
        RuntimeError: they do not fit its networks.
    """
    model.policy.load_state_dict({name: torch.from_numpy(w) for name, w in weights.items()})
