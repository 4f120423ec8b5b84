"""Reading `hyperparams/*.yml`, which are in the format of rl-zoo3."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from torch import nn

FOLDER = Path(__file__).parent / "hyperparams"
ACTIVATIONS = {"tanh": nn.Tanh, "relu": nn.ReLU, "elu": nn.ELU, "silu": nn.SiLU}
_WRAPPER = "agents.training_env.ScaledReward"


@dataclasses.dataclass(frozen=True)
class Hyperparameters:
    """One entry of a file.

    Attributes:
        n_envs: environments side by side.
        n_timesteps: environment steps, all environments together.
        reward_scale: factor on the reward that the learner sees.
        algorithm: keyword arguments of PPO or SAC, `policy` among them.
        written: the entry as it was written, plain JSON values.
    """

    n_envs: int
    n_timesteps: int
    reward_scale: float
    algorithm: dict[str, Any]
    written: dict[str, Any]


def hyperparameters(algo: str, imitation: bool, folder: Path = FOLDER) -> Hyperparameters:
    """Those of an algorithm, from scratch or from a clone.

    Raises:
        ValueError: there is no such file, entry or activation.
    """
    path, entry = folder / f"{algo}.yml", "RimlessWheel-v0" + "-imitation" * imitation
    if not path.is_file():
        known = sorted(p.stem for p in folder.glob("*.yml"))
        raise ValueError(f"algo = {algo!r}: choose from {known}")
    entries = yaml.safe_load(path.read_text())
    if entry not in entries:
        raise ValueError(f"{path}: no entry {entry!r}; it has {list(entries)}")
    written = entries[entry]
    values = copy.deepcopy(written)
    n_envs, n_timesteps = int(values.pop("n_envs")), int(values.pop("n_timesteps"))
    scale = 1.0
    for wrapper in values.pop("env_wrapper", []):
        if list(wrapper) != [_WRAPPER]:
            raise ValueError(f"{path}: env_wrapper {list(wrapper)}: only {_WRAPPER} is known")
        scale = float(wrapper[_WRAPPER]["scale"])
    for name in ("learning_rate", "clip_range"):
        if isinstance(values.get(name), str):
            values[name] = _linear(values[name])
    kwargs = values.get("policy_kwargs", {})
    if "activation_fn" in kwargs:
        if kwargs["activation_fn"] not in ACTIVATIONS:
            raise ValueError(
                f"{path}: activation_fn {kwargs['activation_fn']!r}: "
                f"choose from {list(ACTIVATIONS)}"
            )
        kwargs["activation_fn"] = ACTIVATIONS[kwargs["activation_fn"]]
    return Hyperparameters(n_envs, n_timesteps, scale, values, written)


def _linear(text: str) -> Callable[[float], float]:
    """rl-zoo3's "lin_x": from x to 0 as training goes on."""
    prefix, _, start = text.partition("_")
    if prefix != "lin":
        raise ValueError(f"schedule {text!r}: write a number, or lin_ and a number")
    # The last rollout may end after the last time step, and `remaining` below 0.
    return lambda remaining: float(start) * max(remaining, 0.0)
