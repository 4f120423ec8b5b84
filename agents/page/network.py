"""A policy's network for a page: its layers, packed."""

from __future__ import annotations

from typing import Any

from agents.page.packing import packed
from agents.policy_files import Checkpoint
from rimless_gym.envs.arguments import USUAL

#: Layers of the actor of stable-baselines3's PPO, without their `.weight` and `.bias`.
_HIDDEN, _LAST = "mlp_extractor.policy_net.", "action_net"


def network_data(policy: Checkpoint) -> list[dict[str, Any]]:
    """The layers of a policy's network as JSON values; tanh follows all but the last.

    Raises:
        ValueError: it is not a network of tanh layers that sets the voltage every 10 ms, as PPO
            of this package trains.
    """
    kwargs, weights = policy.record.get("policy_kwargs", {}), policy.parts.weights
    plain = policy.conditions.control == USUAL and kwargs.get("activation_fn", "Tanh") == "Tanh"
    hidden = sorted(
        (name.removesuffix(".weight") for name in weights if _is_hidden(name)),
        key=lambda name: int(name.removeprefix(_HIDDEN)),
    )
    if not (policy.algo == "ppo" and plain and hidden):
        raise ValueError(
            f"a {policy.algo} policy with {policy.conditions.control} and {kwargs}: a page runs "
            "networks of tanh layers that set the voltage every 10 ms; choose such a policy, as "
            "'imitation' or 'distilled'"
        )
    return [
        {
            "outputs": int(weights[f"{name}.weight"].shape[0]),
            "weights": packed(weights[f"{name}.weight"]),
            "biases": packed(weights[f"{name}.bias"]),
        }
        for name in (*hidden, _LAST)
    ]


def _is_hidden(name: str) -> bool:
    return name.startswith(_HIDDEN) and name.endswith(".weight")
