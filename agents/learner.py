"""What a learner is: a class with two methods, `learn` and `act`; anything else is optional.

A learner joins by one more entry in `LEARNERS`. With `settings` it has hyperparameters, with
`parts` and `load` its policies are kept in files, with `state` and `restore` a killed training goes
on, with `imitate` it can begin from a clone.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import pkgutil
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.rollout import Act, Policy
from rimless_gym.checks import extra
from rimless_gym.envs.task import Task
from trajopt.pool import announce

if TYPE_CHECKING:
    from agents.imitation import CloneReport, Cloning
    from agents.prior import Prior

#: Where each learner is: module and class.
LEARNERS = {
    "cma_es": "agents.sb3.cma_es:CmaEs",
    "evolution": "agents.evolution.learner:Evolution",
    "gradients": "agents.sb3.gradients:Gradients",
    "ppo": "agents.sb3.learner:Ppo",
    "sac": "agents.sb3.sac:Sac",
}

#: What a training can begin from, besides a policy's file.
SCRATCH, IMITATION = "scratch", "imitation"
INITS = (SCRATCH, IMITATION)

#: Whose hyperparameters a training with a prior has, whatever it begins from.
PRIOR = "prior"

#: The policies that a training leaves in its folder: the clone that it began with, the best in the
#: periodic evaluations, and the last.
CLONE, BEST, LAST = "clone.zip", "best.zip", "last.zip"


class DoesNotWalkError(ValueError):
    """The policy from which a training begins, or which it imitates, does not walk."""


#: No changes to a learner's hyperparameters.
NO_CHANGES: Mapping[str, Any] = MappingProxyType({})


def learner_class(name: str) -> type[Learner]:
    """The learner of a name.

    Raises:
        ValueError: there is none of that name.
        MissingExtraError: what it is built on is not installed.
    """
    if name not in LEARNERS:
        raise ValueError(f"algo = {name!r}: choose from {sorted(LEARNERS)}")
    with extra("learn"):
        if "torch" not in sys.modules and importlib.util.find_spec("torch"):
            announce("loading PyTorch (some seconds, longer the first time)")
        learner: type[Learner] = pkgutil.resolve_name(LEARNERS[name])
    return learner


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearnerSettings:
    """Hyperparameters. A learner derives its own from these.

    Attributes:
        n_timesteps: time steps of a training, unless a number is given. A step is a control
            interval, or several if the learner holds its actions for so long.
    """

    n_timesteps: int = 100_000

    @property
    def intervals_per_step(self) -> int:
        """Control intervals for which the learner holds an action."""
        return 1

    @property
    def written(self) -> dict[str, Any]:
        """Plain JSON values that distinguish these settings from others."""
        return dataclasses.asdict(self)


@dataclasses.dataclass(frozen=True)
class Training:
    """Everything that determines the trained policy.

    Attributes:
        algo: the learner's name.
        init: "scratch", "imitation", or a description of the policy to start from.
        seed: of everything random.
        conditions: parameters, control, ranges and disturbances.
        task: the reward.
        settings: hyperparameters.
        prior: see `agents.prior`; its name, before it is made; or None.
    """

    algo: str
    init: str
    seed: int
    conditions: Conditions
    task: Task
    settings: LearnerSettings
    prior: Prior | str | None = None

    @property
    def identity(self) -> dict[str, Any]:
        """The training as plain JSON values, by which a folder is known to hold it."""
        return {
            "algo": self.algo,
            "init": self.init,
            "seed": self.seed,
            "task": dataclasses.asdict(self.task),
            "hyperparameters": self.settings.written,
            **({} if self.prior is None else {"prior": str(self.prior)}),
            **self.conditions.to_dict(),
        }


@dataclasses.dataclass(frozen=True)
class PolicyParts:
    """A policy taken apart, as a file can hold it.

    Attributes:
        record: plain JSON values that describe it, such as the sizes of its networks.
        weights: floating-point arrays by name.
    """

    record: dict[str, Any]
    weights: dict[str, NDArray[Any]]


class Callback(Protocol):
    """What a learner calls while it learns."""

    @property
    def log(self) -> Any:
        """For the learner's own figures, a `Logger` of stable-baselines3."""

    def on_iteration(self) -> None:
        """To be called before every iteration, when the learner's state is complete.

        Evaluates the policy and saves the training when that is due.

        Raises:
            KeyboardInterrupt: the training was stopped; everything is saved.
        """

    def on_step(self) -> None:
        """To be called whenever `steps` has grown, to move the progress bar."""

    def on_phase(self, name: str) -> None:
        """Name in the progress bar what takes long while `steps` does not grow; "" when over."""


class Learner(ABC):
    """Learns a policy. The constructor begins a training.

    Args:
        training: what to learn.
        start: the policy to start from; None: a new one.

    Attributes:
        default_settings: hyperparameters that `settings` changes.
        recommended: the file of a finished training whose policy to take.
        takes_prior: whether it can train with a prior, see `agents.prior`.
        steps: time steps so far, all environments together; `learn` counts them.

    Raises:
        ValueError: `start` does not fit the learner.
    """

    default_settings: ClassVar[LearnerSettings] = LearnerSettings()
    recommended: ClassVar[str] = BEST
    takes_prior: ClassVar[bool] = False
    steps: int = 0

    @abstractmethod
    def __init__(self, training: Training, start: PolicyParts | None = None) -> None: ...

    @abstractmethod
    def learn(self, until: int, callback: Callback) -> None:
        """Learn until there have been `until` steps or a few more."""

    @property
    @abstractmethod
    def act(self) -> Act:
        """The deterministic policy as it is now."""

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> LearnerSettings:
        """The hyperparameters of a training from scratch if `init` says so, else from a policy.

        Args:
            init: what a training begins from.
            changes: values that differ from the learner's own.

        Raises:
            TypeError: a value is of the wrong kind.
            ValueError: there is no such hyperparameter, or a value is out of its range.
        """
        names = [field.name for field in dataclasses.fields(cls.default_settings)]
        require_known(changes, names)
        return dataclasses.replace(cls.default_settings, **changes)

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy that a learner of this class took apart, without a training.

        It may raise anything if the parts do not fit together. Their record has entries of
        `agents.policy_files` too; conditions and task are those of the training.
        """
        raise NotImplementedError(f"{cls.__name__}.load: its policies are not kept in files")

    def parts(self) -> PolicyParts | None:
        """The policy as it is now, for a file; None: it is not kept in files."""
        return None

    def state(self) -> dict[str, Any] | None:
        """All that future learning depends on: plain values, arrays and tensors, nested.

        It is needed between two iterations. None: a killed training begins anew.
        """
        return None

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state of a learner in the same training."""
        raise NotImplementedError(f"{type(self).__name__}.restore: it has no state")

    def imitate(self, expert: Policy, cloning: Cloning, progress: bool) -> CloneReport:
        """Make the policy act as `expert` does."""
        raise NotImplementedError(f"{type(self).__name__}.imitate: it cannot imitate")

    def close(self) -> None:  # noqa: B027  most learners have nothing to close
        """Close environments and files."""


def require_known(changes: Mapping[str, Any], names: list[str]) -> None:
    """Refuse hyperparameters that a learner does not have, and numbers that are not finite."""
    for name, value in changes.items():
        if name not in names:
            raise ValueError(f"hyperparameters: {name!r} is not known; choose from {names}")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"hyperparameters: {name} = {value}: must be finite")
