"""What to train, and how: a `TrainingConfig` and its checks."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

from agents.conditions import Conditions
from agents.evaluate import TRAINING_PROTOCOL, Evaluation, Protocol
from agents.experts import EXPERT, OwnLaws
from agents.imitation import LASTING, Cloning, as_cloning
from agents.learner import (
    IMITATION,
    INITS,
    PRIOR,
    SCRATCH,
    Learner,
    LearnerSettings,
    Training,
    learner_class,
)
from agents.policy_files import origin
from agents.prior import LAW, Prior
from rimless_gym.checks import integer
from rimless_gym.envs.arguments import as_task
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.task import Task
from rimless_gym.presets import BUILDABLE, Machine
from trajopt.feedback import laws
from trajopt.feedback.law import Controller

#: The largest that numpy's global generator takes.
MAX_SEED = 2**32 - 1


@dataclasses.dataclass(frozen=True)
class TrainingConfig:
    """What to train, and how.

    Attributes:
        algo: name of a learner, one of `agents.learner.LEARNERS`.
        init: "scratch", "imitation" (clone `expert` first), or a policy's file to start from.
        seed: of everything random, from 0 to 2**32 - 1. The same seed gives the same policy.
        timesteps: time steps in all; default: those of the hyperparameters. A finished
            training goes on if more are asked for.
        params: the wheel's parameters, as the environment takes them.
        task: the reward, default: that of the environment; or a dictionary of some of its fields.
        ranges: of parameters, as the environment takes them, for training and evaluation.
        disturbances: as the environment takes them, for training and evaluation.
        speeds: between which a speed is commanded (m/s), as in `RimlessWheelSpeed-v0`;
            None: no speed is commanded, as in `RimlessWheel-v0`.
        control_period: how long an action is held (s), default: that of the environment.
        hyperparameters: that differ from the learner's own; or all of them, as its `settings`.
        expert: to imitate, see `agents.experts.expert_policy`.
        startup: whether an expert in a file is imitated near its own gait only, and far from it the
            start-up controller of that gait.
        cloning: how, default `Cloning()`, or `LASTING` of `agents.imitation` with `startup`; or a
            dictionary of some of its fields.
        prior: a prior of this machine, task and control period, see `agents.prior`; "law": that of
            the usual expert; None: nothing is known.
        score: what "best" means, larger is better; default: `walking_economy`, or the reward
            where a speed is commanded.
        protocol: of the periodic evaluations.
    """

    algo: str
    init: str = SCRATCH
    seed: int = 0
    timesteps: int | None = None
    params: Machine = BUILDABLE
    task: Task | Mapping[str, float] | None = None
    ranges: Ranges | Mapping[str, Any] | None = None
    disturbances: Disturbances | Mapping[str, Any] | None = None
    speeds: tuple[float, float] | None = None
    control_period: float | None = None
    hyperparameters: LearnerSettings | Mapping[str, Any] = dataclasses.field(default_factory=dict)
    expert: Controller | OwnLaws | str = EXPERT
    startup: bool = False
    cloning: Cloning | Mapping[str, Any] | None = None
    prior: Prior | str | None = None
    score: Callable[[Evaluation], float] | None = None
    protocol: Protocol = TRAINING_PROTOCOL

    def training(self) -> Training:
        """What determines the policy, checked.

        Raises:
            ValueError: a value is out of range, or two contradict each other.
            TypeError: a value is of the wrong kind.
            CheckpointError: a policy to start from, or to imitate, cannot be read.
        """
        given = self.expert != EXPERT or self.startup or self.cloning is not None
        if self.init != IMITATION and given:
            raise ValueError(
                f"init = {self.init!r}: expert, startup and cloning are for init = {IMITATION!r} "
                "only"
            )
        if self.startup and (not isinstance(self.expert, str) or self.expert in laws.names()):
            raise ValueError(
                f"startup: expert = {self.expert!r} is a feedback law, which has its own start-up "
                "controller; give a policy's file, or leave out startup"
            )
        if self.startup and self.speeds is not None:
            raise ValueError(
                f"startup, speeds = {self.speeds}: a start-up controller leads to one gait; leave "
                "out one of them"
            )
        kind = learner_class(self.algo)
        if self.init == IMITATION and kind.imitate is Learner.imitate:
            raise ValueError(
                f"init = {IMITATION!r}: {self.algo} cannot imitate; begin from {SCRATCH!r}, or "
                "from a policy's file"
            )
        if self.prior is not None and not kind.takes_prior:
            raise ValueError(f"prior = {self.prior}: {self.algo} takes none; choose ppo or sac")
        settings = self.hyperparameters
        if not isinstance(settings, LearnerSettings):
            settings = kind.settings(self.init if self.prior is None else PRIOR, settings)
        if self.timesteps is not None:
            integer("timesteps", self.timesteps, 0)
        conditions = Conditions.of(
            self.params, self.ranges, self.disturbances, self.speeds, self.control_period
        )
        task = as_task(self.task, conditions.default_task)
        if isinstance(self.prior, Prior):
            self.prior.require(conditions.params, task, conditions.control.period)
        elif self.prior not in (None, LAW):
            raise ValueError(f"prior = {self.prior!r}: must be {LAW!r}, or a Prior of agents.prior")
        elif self.prior is not None and conditions.commanded:
            raise ValueError(f"prior = {LAW!r}: holds one gait; leave out speeds, or the prior")
        if self.prior is not None and self.init == IMITATION:
            raise ValueError(
                f"init = {self.init!r}, prior = {self.prior}: a clone needs no prior; leave out one"
            )
        return Training(
            self.algo,
            self._start(),
            integer("seed", self.seed, 0, MAX_SEED),
            conditions,
            task,
            settings,
            self.prior,
        )

    @property
    def how_to_clone(self) -> Cloning:
        """All of `cloning`."""
        return as_cloning(self.cloning, LASTING if self.startup else None)

    def _start(self) -> str:
        """What the training begins from, in words."""
        if self.init != IMITATION:
            return self.init if self.init in INITS else origin(self.init)
        words, usual = self.init, dataclasses.asdict(Cloning())
        if isinstance(self.expert, str) and self.expert != EXPERT:
            words += f" of {self.expert if self.expert in laws.names() else origin(self.expert)}"
        if self.startup:
            words += " and its start-up controller"
        cloning = dataclasses.asdict(self.how_to_clone)
        changed = {k: v for k, v in cloning.items() if v != usual[k]}
        return words + (f" with {json.dumps(changed)}" if changed else "")
