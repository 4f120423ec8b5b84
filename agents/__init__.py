"""Learning to walk: training, imitation of the optimal gait, and the evaluation protocol."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.sb3_vec_env import Sb3VecEnv

__all__ = ["Sb3VecEnv"]


def __getattr__(name: str) -> Any:
    """`Sb3VecEnv`, imported when it is used, for stable-baselines3 takes seconds to import."""
    if name != "Sb3VecEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from agents.sb3_vec_env import Sb3VecEnv

    return Sb3VecEnv
