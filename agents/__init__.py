"""Learning to walk: training, imitation of the optimal gait, and the evaluation protocol."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.checkpoint import PRETRAINED, load_policy, save_policy
    from agents.sb3_vec_env import Sb3VecEnv

__all__ = ["PRETRAINED", "Sb3VecEnv", "load_policy", "save_policy"]

_HOMES = {
    "PRETRAINED": "agents.checkpoint",
    "Sb3VecEnv": "agents.sb3_vec_env",
    "load_policy": "agents.checkpoint",
    "save_policy": "agents.checkpoint",
}


def __getattr__(name: str) -> Any:
    """Import a name when it is first used: stable-baselines3 takes seconds to import."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
