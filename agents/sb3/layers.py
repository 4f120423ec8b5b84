"""What lies around the environments of a training: finding a layer, and what it is made from."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any, TypeVar

from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

Layer = TypeVar("Layer", bound=VecEnv)


def layers_of(env: Any) -> Iterator[VecEnv]:
    """All layers from the outside in; the last are the environments themselves."""
    while isinstance(env, VecEnvWrapper):
        yield env
        env = env.venv
    yield env


def layer_of(env: Any, kind: type[Layer]) -> Layer:
    """The outermost layer of a kind.

    Raises:
        TypeError: there is none.
    """
    for layer in layers_of(env):
        if isinstance(layer, kind):
            return layer
    raise TypeError(f"{env}: has no {kind.__name__} around its environments or among them")


def arguments_of(kind: type[VecEnvWrapper]) -> dict[str, Any]:
    """Names and defaults of the arguments of a layer, without what it encloses and its seed."""
    _, *given = inspect.signature(kind).parameters.values()
    return {each.name: each.default for each in given if each.name != "seed"}


def is_drawn(kind: type[VecEnvWrapper]) -> bool:
    """Whether a layer draws random numbers, from a seed of its own."""
    return "seed" in inspect.signature(kind).parameters
