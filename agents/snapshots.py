"""The state of a vector environment as arrays and plain values, which a file can hold."""

from __future__ import annotations

from typing import Any

from rimless_gym import RimlessWheelVectorEnv
from rimless_gym.envs.batch import ARRAYS


def state_of(envs: RimlessWheelVectorEnv) -> dict[str, Any]:
    """All that changes while environments are stepped, in copies."""
    snapshot = envs.get_state()
    return {
        "arrays": {name: snapshot["batch"][name] for name in ARRAYS},
        "generators": snapshot["generators"],
        "seen": snapshot["seen"],
    }


def restore(envs: RimlessWheelVectorEnv, state: dict[str, Any]) -> None:
    """Put environments that were made with the same arguments into a state of `state_of`.

    Raises:
        KeyError: a part of it is missing.
        TypeError: a part of it is of the wrong kind.
        ValueError: it is from another number of environments.
    """
    batch = envs.get_state()["batch"]
    envs.set_state(
        {
            "batch": batch | {name: state["arrays"][name] for name in ARRAYS},
            "generators": state["generators"],
            "seen": state["seen"],
        }
    )
