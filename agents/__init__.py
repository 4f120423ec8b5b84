"""Learning to walk: training, imitation and the evaluation protocol; part of rimless-gym."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.policy_files import PRETRAINED, load_policy
    from agents.sb3.vec_env import Sb3VecEnv
    from agents.training import train
    from agents.training_config import TrainingConfig

__all__ = ["PRETRAINED", "Sb3VecEnv", "TrainingConfig", "load_policy", "train"]

_HOMES = {
    "PRETRAINED": "agents.policy_files",
    "Sb3VecEnv": "agents.sb3.vec_env",
    "TrainingConfig": "agents.training_config",
    "load_policy": "agents.policy_files",
    "train": "agents.training",
}


def __getattr__(name: str) -> Any:
    """Import a name when it is first used: stable-baselines3 takes seconds to import."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
