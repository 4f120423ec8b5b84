"""Reading `agents/hyperparams/*.yml`, which are in the format of rl-zoo3."""

from __future__ import annotations

import ast
import copy
import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml
from torch import nn

from agents.learner import NO_CHANGES
from agents.sb3.layers import arguments_of
from agents.sb3.pacing import Pacing
from agents.sb3.training_env import LAYERS, HeldActions, Offer
from agents.training import Settings
from rimless_gym.checks import integer, positive

FOLDER = Path(__file__).parents[1] / "hyperparams"
ACTIVATIONS = {"Tanh": nn.Tanh, "ReLU": nn.ReLU, "ELU": nn.ELU, "SiLU": nn.SiLU}
#: The most environments of a training.
MOST_ENVS = 65_536
#: What is not the algorithm's.
ENVIRONMENTS = ("n_envs", "n_timesteps", "env_wrapper", "vec_env_wrapper", "callback")

_LIMITED = "gymnasium.wrappers.TimeLimit"
_PACED = "agents.sb3.pacing.SelfPacedPrice"
#: `LAYERS` as they are written in a file, and the arguments of what may be listed under each key.
_LAYERS = {f"{kind.__module__}.{kind.__qualname__}": kind for kind in LAYERS}
ENV_WRAPPERS = {_LIMITED: ["max_episode_steps"]}
WRAPPERS = {name: list(arguments_of(kind)) for name, kind in _LAYERS.items()}
CALLBACKS = {_PACED: [field.name for field in dataclasses.fields(Pacing)]}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hyperparameters(Settings):
    """One entry of a file.

    Attributes:
        n_envs: environments side by side.
        offer: what the environments offer.
        pacing: of the price of distance; None: the task's own price is paid.
        algorithm: keyword arguments of the algorithm, `policy` among them.
        entry: as it was written, plain JSON values.
    """

    n_envs: int
    offer: Offer
    pacing: Pacing | None = None
    algorithm: dict[str, Any]
    entry: dict[str, Any]

    @property
    def intervals_per_step(self) -> int:
        """Control intervals for which an action is held."""
        return int(self.offer.value(HeldActions, "intervals"))

    @property
    def written(self) -> dict[str, Any]:
        """The entry."""
        return self.entry


def hyperparameters(
    file: str, imitation: bool, changes: Mapping[str, Any] = NO_CHANGES, folder: Path = FOLDER
) -> Hyperparameters:
    """The entry of a file for a training from scratch, or from a policy.

    Args:
        file: its name.
        imitation: whether the training begins from a policy.
        changes: values that take the place of those in the file, or come beside them.
        folder: of the file.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: there is no such file or entry, or something in it is not as rl-zoo3 writes it.
    """
    path, entry = folder / file, "RimlessWheel-v0" + "-imitation" * imitation
    if not path.is_file():
        raise ValueError(f"{path}: no such file of hyperparameters")
    entries = yaml.safe_load(path.read_text())
    if entry not in entries:
        raise ValueError(f"{path}: no entry {entry!r}; it has {list(entries)}")
    written = entries[entry] | dict(changes)
    values = copy.deepcopy(written)
    n_envs = integer("n_envs", values.pop("n_envs"), 1, MOST_ENVS)
    n_timesteps = integer("n_timesteps", values.pop("n_timesteps"), 0)
    limits = _classes(values, "env_wrapper", ENV_WRAPPERS)
    wrappers = _classes(values, "vec_env_wrapper", WRAPPERS)
    ordered = [name for name in WRAPPERS if name in wrappers]
    if list(wrappers) != ordered:
        raise ValueError(f"vec_env_wrapper: lists {list(wrappers)}; the order must be {ordered}")
    callbacks = _classes(values, "callback", CALLBACKS)
    for name in ("learning_rate", "clip_range"):
        if name in values:
            values[name] = _schedule(name, values[name])
    if "policy_kwargs" in values:
        text = values["policy_kwargs"]
        try:
            values["policy_kwargs"] = _written(ast.parse(text, mode="eval").body)
        except (SyntaxError, TypeError, ValueError, RecursionError, MemoryError) as error:
            raise ValueError(
                f"policy_kwargs = {text!r}: write dict(name=value, ...) of plain values and "
                f"activations, one of {[f'nn.{name}' for name in ACTIVATIONS]}"
            ) from error
    return Hyperparameters(
        n_timesteps=n_timesteps,
        silent=integer("learning_starts", values.get("learning_starts", 0), 0),
        n_envs=n_envs,
        offer=Offer(
            {_LAYERS[name]: arguments for name, arguments in wrappers.items()},
            limits.get(_LIMITED, {}).get("max_episode_steps"),
        ),
        pacing=Pacing(**callbacks[_PACED]) if _PACED in callbacks else None,
        algorithm=values,
        entry=written,
    )


def _classes(
    values: dict[str, Any], key: str, known: Mapping[str, list[str]]
) -> dict[str, dict[str, Any]]:
    """The arguments of the classes that are listed under a key, which is taken out of `values`.

    Raises:
        ValueError: a class or one of its arguments is not known.
    """
    found: dict[str, dict[str, Any]] = {}
    entries = values.pop(key, [])
    for entry in entries if isinstance(entries, list) else [entries]:
        for name, arguments in (entry if isinstance(entry, dict) else {entry: {}}).items():
            if name not in known:
                raise ValueError(f"{key} = {entries!r}: {name!r} is not known; list {list(known)}")
            arguments = {} if arguments is None else arguments
            if not isinstance(arguments, dict) or not arguments.keys() <= set(known[name]):
                raise ValueError(
                    f"{key} = {entries!r}: the arguments of {name} must be some of {known[name]}; "
                    f'write {{"{name}": {{"{known[name][0]}": ...}}}}'
                )
            found[name] = arguments
    return found


def _written(node: ast.expr) -> Any:
    """The value of an expression. rl-zoo3 evaluates any; here, only those that it needs."""
    match node:
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=entries) if all(
            entry.arg for entry in entries
        ):
            return {entry.arg: _written(entry.value) for entry in entries}
        case ast.Attribute(value=ast.Name(id="nn"), attr=name) if name in ACTIVATIONS:
            return ACTIVATIONS[name]
    return ast.literal_eval(node)


def _schedule(name: str, value: Any) -> float | Callable[[float], float]:
    """A number, or rl-zoo3's "lin_x": falls from x to 0 during the training.

    Raises:
        TypeError: it is neither a number nor text.
        ValueError: it is not greater than 0, or it is written in another way.
    """
    if not isinstance(value, str):
        return positive(name, value)
    prefix, _, number = value.partition("_")
    try:
        if prefix != "lin":
            raise ValueError("another schedule")
        start = positive(name, float(number))
    except ValueError as error:
        raise ValueError(
            f"{name} = {value!r}: write a number, or lin_ and a number greater than 0"
        ) from error
    # The last roll-out may end after the last time step; `remaining` is negative then.
    return lambda remaining: start * max(remaining, 0.0)
