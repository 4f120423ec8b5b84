"""What a learner is.

A learner is a class `Learner` in a file of `agents/learners`, derived from the one below. Training,
evaluation, policy files, resumption and the command lines need nothing else of it.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.folder import BEST
from agents.imitation import CloneReport, Cloning
from agents.policies import Act, Policy
from agents.training import Settings, Training
from rimless_gym.envs.task import Task


@dataclasses.dataclass(frozen=True)
class PolicyParts:
    """A policy taken apart, as a file can hold it.

    Attributes:
        record: plain JSON values that describe it, such as the sizes of its networks.
        weights: floating-point arrays by name.
    """

    record: dict[str, Any]
    weights: dict[str, NDArray[Any]]


class Log(Protocol):
    """Where figures of a training go; stable-baselines3's `Logger` is one."""

    def record(self, key: str, value: Any) -> None:
        """Note a figure until the next `dump`."""

    def dump(self, step: int = 0) -> None:
        """Write the figures noted since the last time, as those of `step` control intervals."""


class Watch(Protocol):
    """What watches over a training, as its learner sees it."""

    @property
    def log(self) -> Log:
        """For the learner's own figures."""

    def between(self) -> None:
        """To be called before every iteration, when the learner's state is complete.

        Evaluates the policy and saves the training when that is due.

        Raises:
            KeyboardInterrupt: somebody asked to stop; everything is saved.
        """

    def advanced(self) -> None:
        """To be called whenever `steps` has grown, to move the progress bar."""

    def doing(self, what: str) -> None:
        """Say in the progress bar what takes long while `steps` does not grow; "" when over."""


#: No changes to a learner's hyperparameters.
NO_CHANGES: Mapping[str, Any] = MappingProxyType({})


def require_known(changes: Mapping[str, Any], names: Sequence[str]) -> None:
    """Refuse hyperparameters that a learner does not have, and numbers that are not finite.

    Raises:
        ValueError: there is one.
    """
    for name, value in changes.items():
        if name not in names:
            raise ValueError(f"settings: {name!r} is not known; choose from {list(names)}")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"settings: {name} = {value}: must be finite")


class Learner(ABC):
    """Learns a policy. The constructor begins a training.

    Args:
        training: what to learn.
        start: the policy to start from; None: a new one.

    Raises:
        ValueError: `start` does not fit the learner.
    """

    #: Whether it can imitate an expert.
    imitates: ClassVar[bool] = False

    #: The file of a finished training whose policy to take.
    recommended: ClassVar[str] = BEST

    @abstractmethod
    def __init__(self, training: Training, start: PolicyParts | None = None) -> None: ...

    @classmethod
    @abstractmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> Settings:
        """The hyperparameters of a training from scratch if `init` says so, else from a policy.

        Args:
            init: what a training begins from.
            changes: values that differ from the learner's own.

        Raises:
            TypeError: a value is of the wrong kind.
            ValueError: there is no such hyperparameter, or a value is out of its range.
        """

    @classmethod
    def advice(cls, training: Training) -> list[str]:
        """Why a training cannot lead to walking, each reason with its numbers; usually none."""
        return []

    @classmethod
    @abstractmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy that a learner of this class took apart, without a training.

        It may raise anything if the parts do not fit together.

        Args:
            parts: of the policy. The record has entries of `agents.policy_files` too.
            conditions: machine and control in which it was trained.
            task: the reward that it was trained for.
        """

    @property
    @abstractmethod
    def steps(self) -> int:
        """Time steps so far, all environments together."""

    @property
    @abstractmethod
    def act(self) -> Act:
        """The deterministic policy as it is now."""

    @abstractmethod
    def learn(self, until: int, watch: Watch) -> None:
        """Learn until there have been `until` steps or a few more."""

    @abstractmethod
    def parts(self) -> PolicyParts:
        """The policy as it is now, for a file.

        Raises:
            ValueError: it cannot be described by plain values.
        """

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """All that future learning depends on, as a tree for `agents.trees`.

        It is asked for between two iterations.
        """

    @abstractmethod
    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state of a learner in the same training.

        It may raise anything if the state does not fit; the learner is not used then.
        """

    def imitate(self, expert: Policy, cloning: Cloning, kept: Path, progress: bool) -> CloneReport:
        """Make the policy act as `expert` does.

        Args:
            expert: whom to imitate.
            cloning: how to clone it.
            kept: file for the rounds done so far, from which a stopped cloning goes on.
            progress: whether to show a progress bar.

        Only learners that say so in `imitates` are asked to.
        """
        raise NotImplementedError

    def close(self) -> None:  # noqa: B027  most learners have nothing to close
        """Close environments and files."""
