"""Reading `agents/hyperparams/*.yml`, which are in the format of rl-zoo3."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import math
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize
from torch import nn

from agents.learner import NO_CHANGES, PRIOR, SCRATCH, LearnerSettings, require_known
from agents.sb3.wrappers import HeldActions, Wrapping
from rimless_gym.checks import as_instance, flag, integer, positive, real, require_kind

FOLDER = Path(__file__).parents[1] / "hyperparams"

#: Activations by the names that they have in files.
ACTIVATIONS = {"Tanh": nn.Tanh, "ReLU": nn.ReLU, "ELU": nn.ELU, "SiLU": nn.SiLU}

#: The most environments of a training.
MOST_ENVS = 65_536

#: What a training changes on its way: the standard deviation of the exploration noise of actions,
#: and the weight of a prior's potential.
ANNEALED = ("noise", "potential")

#: What is not the algorithm's.
ENVIRONMENTS = ("n_envs", "n_timesteps", "env_wrapper", "vec_env_wrapper", *ANNEALED)

#: Arguments of stable-baselines3's algorithms that are no hyperparameters here. Those after the
#: first line are objects, need a state that is not saved, or change nothing learned.
NOT_OURS = (
    *("env", "seed", "device", "verbose", "tensorboard_log", "_init_setup_model"),
    *("use_sde", "sde_sample_freq", "use_sde_at_warmup", "action_noise", "optimize_memory_usage"),
    *("replay_buffer_class", "replay_buffer_kwargs", "rollout_buffer_class"),
    *("rollout_buffer_kwargs", "stats_window_size"),
)

#: Integers that may be less than 1; with -1, there are as many gradient steps as time steps.
LEAST = {"gradient_steps": -1, "learning_starts": 0}

#: How arguments of one plain type are checked: stable-baselines3 takes any, and fails later.
PLAIN: dict[Any, Callable[[str, Any], Any]] = {
    int: lambda name, value: integer(name, value, LEAST.get(name, 1)),
    float: real,
    bool: flag,
}

#: Those that are between 0 and 1.
SHARES = ("gamma", "gae_lambda", "tau")

#: What `env_wrapper` may list.
_TIME_LIMIT = "gymnasium.wrappers.TimeLimit"


@dataclasses.dataclass(frozen=True)
class Annealed:
    """A number that changes geometrically within a training.

    Raises:
        TypeError: one is no number.
        ValueError: not 0 < first, last, or not 0 <= begin < end <= 1.
    """

    # first, last: its values, greater than 0
    first: float
    last: float
    # begin, end: between which shares of the training it changes
    begin: float
    end: float

    def __post_init__(self) -> None:
        positive("first", self.first)
        positive("last", self.last)
        if not 0 <= real("begin", self.begin) < real("end", self.end) <= 1:
            raise ValueError(f"begin = {self.begin}, end = {self.end}: must rise within 0 and 1")

    def at(self, done: float) -> float:
        """Its value after a share `done` of the training."""
        late = min(max((done - self.begin) / (self.end - self.begin), 0.0), 1.0)
        return float(self.first ** (1.0 - late) * self.last**late)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hyperparameters(LearnerSettings):
    """One entry of a file.

    Attributes:
        n_envs: environments side by side.
        wrappers: around them, from the inside out.
        episode_steps: control intervals of the longest episode; None: as the environment has them.
        annealed: what changes on the way, some of `ANNEALED`.
        algorithm: keyword arguments of the algorithm, `policy` among them.
        entry: as it was written, plain JSON values.
    """

    n_envs: int
    wrappers: tuple[Wrapping, ...] = ()
    episode_steps: int | None = None
    annealed: dict[str, Annealed] = dataclasses.field(default_factory=dict)
    algorithm: dict[str, Any]
    entry: dict[str, Any]

    @property
    def intervals_per_step(self) -> int:
        """Control intervals for which an action is held."""
        held = [given.get("intervals", 1) for kind, given in self.wrappers if kind is HeldActions]
        return math.prod(held)

    @property
    def written(self) -> dict[str, Any]:
        """The entry."""
        return self.entry


def hyperparameters(
    algorithm: type, file: str, init: str, changes: Mapping[str, Any] = NO_CHANGES
) -> Hyperparameters:
    """The entry of a file in `agents/hyperparams` for a training from scratch, or from a policy.

    `changes` take the place of values in the file, or come beside them.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: there is no such hyperparameter, or it is not written as rl-zoo3 writes it.
    """
    signature = inspect.signature(algorithm).parameters
    taken = {name: value for name, value in signature.items() if name not in NOT_OURS}
    require_known(changes, [*ENVIRONMENTS, *taken])
    if init != PRIOR and (unused := [name for name in ANNEALED if name in changes]):
        raise ValueError(f"{unused[0]}: changes only in a training with a prior; leave it out")
    for name, value in changes.items():
        if name in taken and taken[name].annotation in PLAIN:
            PLAIN[taken[name].annotation](name, value)
        if name in SHARES and not 0.0 <= value <= 1.0:
            raise ValueError(f"{name} = {value}: must be from 0 to 1")
    entries = yaml.safe_load((FOLDER / file).read_text())
    entry = "RimlessWheel-v0" + {SCRATCH: "", PRIOR: "-prior"}.get(init, "-imitation")
    written = entries[entry] | dict(changes)
    values = copy.deepcopy(written)
    limits = _listed(values, "env_wrapper")
    wrappers = _listed(values, "vec_env_wrapper")
    if not limits.keys() <= {_TIME_LIMIT}:
        raise ValueError(f"env_wrapper: lists {list(limits)}, and only {_TIME_LIMIT} can be")
    n_envs = integer("n_envs", values.pop("n_envs"), 1, MOST_ENVS)
    n_timesteps = integer("n_timesteps", values.pop("n_timesteps"), 0)
    episode_steps = limits.get(_TIME_LIMIT, {}).get("max_episode_steps")
    for name in ("learning_rate", "clip_range"):
        if name in values:
            values[name] = _schedule(name, values[name])
    if "policy_kwargs" in values:
        values["policy_kwargs"] = policy_kwargs(values["policy_kwargs"])
    return Hyperparameters(
        n_timesteps=n_timesteps,
        n_envs=n_envs,
        wrappers=tuple((_imported(path, given), given) for path, given in wrappers.items()),
        episode_steps=episode_steps and integer("max_episode_steps", episode_steps, 1),
        annealed={
            name: as_instance(Annealed, name, values.pop(name), None)
            for name in ANNEALED
            if name in values
        },
        algorithm=values,
        entry=written,
    )


def policy_kwargs(described: Mapping[str, Any]) -> dict[str, Any]:
    """The `policy_kwargs` of an algorithm, with an activation in place of its name.

    Raises:
        TypeError: they are no mapping.
        ValueError: there is no such activation.
    """
    require_kind("policy_kwargs", described, Mapping)
    kwargs = dict(described)
    if "activation_fn" in kwargs:
        name = kwargs["activation_fn"]
        if name not in list(ACTIVATIONS):  # it may be a list, which a dictionary cannot look up
            raise ValueError(f"activation_fn = {name!r}: choose from {list(ACTIVATIONS)}")
        kwargs["activation_fn"] = ACTIVATIONS[name]
    return kwargs


def _listed(values: dict[str, Any], key: str) -> dict[str, dict[str, Any]]:
    """Paths and arguments of the classes that are listed under a key, which is removed."""
    entries = values.pop(key, [])
    listed: dict[str, dict[str, Any]] = {}
    for entry in entries if isinstance(entries, list) else [entries]:
        named = {entry: {}} if isinstance(entry, str) else entry
        if not (isinstance(named, dict) and all(isinstance(a or {}, dict) for a in named.values())):
            raise ValueError(
                f"{key}: {entry!r}: give the path of a class, or a mapping of it to its arguments"
            )
        listed |= {path: arguments or {} for path, arguments in named.items()}
    return listed


def _imported(path: str, arguments: dict[str, Any]) -> type[VecEnvWrapper]:
    """The wrapper of a path, which takes these arguments."""
    try:
        kind = pkgutil.resolve_name(path)
        if not (isinstance(kind, type) and issubclass(kind, VecEnvWrapper)):
            raise ValueError("is no VecEnvWrapper")
        if issubclass(kind, VecNormalize):
            raise ValueError("its statistics are not saved with the policy")
        inspect.signature(kind).bind(None, **arguments)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"vec_env_wrapper: {path!r}: {error}") from error
    return kind


def _schedule(name: str, value: Any) -> float | Callable[[float], float]:
    """A number, or rl-zoo3's "lin_x": falls from x to 0 during the training."""
    if not isinstance(value, str):
        return positive(name, value)
    try:
        start = positive(name, float(value.removeprefix("lin_")))
    except ValueError as error:
        raise ValueError(f"{name} = {value!r}: write lin_ and a number greater than 0") from error
    # The last roll-out may end after the last time step; `remaining` is negative then.
    return lambda remaining: start * max(remaining, 0.0)
