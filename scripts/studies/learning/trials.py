"""How a seed of the study is trained, and how its policies are evaluated."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from agents.conditions import Conditions
from agents.evaluate import ENOUGH, Evaluation, Protocol, evaluate, evaluate_commanded
from agents.experts import EXPERT
from agents.learner import BEST, IMITATION, SCRATCH, DoesNotWalkError
from agents.outcomes import FALLS, WALKS, WindowTotals, outcomes
from agents.policy_files import load_policy
from agents.rollout import Policy, Rollout, draw_starts
from agents.training import train
from agents.training_config import TrainingConfig
from rimless_gym.envs.speed import PERIOD, SPEEDS
from rimless_gym.hybrid import CONTROL_PERIOD, OK
from rimless_gym.presets import BUILDABLE

#: The outcomes of walks whose foot slips, in stance or as it touches down.
SLIPS = ("slips", "slips_at_touchdown")

#: Folder of the laws' gaits and plans, in that of the study: all seeds use them.
CACHE = "plans"


@dataclasses.dataclass(frozen=True)
class WalkFigures:
    """How a policy walks."""

    share: float  # of the starts that walk, in [0, 1]
    falls: float  # of the starts that fall
    slips: float  # of the starts that still take steps at the end, but whose foot slips
    cot: float  # cost of transport of those that walk, from E+; NaN if none gets anywhere
    speed: float  # of those that walk (m/s); NaN if none does
    returned: float = math.nan  # mean return of 20 s (m), from all starts; NaN if not measured

    @classmethod
    def of(cls, walks: Evaluation) -> WalkFigures:
        """The figures of an evaluation."""
        starts = len(walks.outcomes)
        falls = walks.failures.get(FALLS, 0) / starts
        slips = sum(walks.failures.get(outcome, 0) for outcome in SLIPS) / starts
        returned = float(walks.returns.mean())
        return cls(walks.walking_share, falls, slips, walks.cot, walks.speed, returned)


#: What distinguishes a policy from the others of its seed -> how it walks.
Policies: TypeAlias = dict[str, WalkFigures]


@dataclasses.dataclass(frozen=True)
class SeedResult:
    """What became of a seed."""

    policies: Policies  # how they walk
    steps: int  # of the environment, in all
    minutes: float  # of one core, for training; those before a stop included


@dataclasses.dataclass(frozen=True, eq=False)
class StudyRow:
    """A way to learn, over several seeds."""

    name: str  # of its files, and on the command line
    title: str  # in the table
    table: str  # in which it stands, one of those of `rows`
    trial: Trained  # how a seed is trained and evaluated
    enough: float = ENOUGH  # a seed walks if this share of its starts does

    def walks(self, policy: WalkFigures) -> bool:
        """Whether a policy walks from enough starts."""
        return policy.share >= self.enough - 1e-9


class Other(NamedTuple):
    """A policy of another row."""

    row: StudyRow  # the other row
    file: str  # of the policy, in the folder of the same seed


@dataclasses.dataclass(frozen=True)
class Trained:
    """A training by `agents.train`, on `RimlessWheel-v0`."""

    algo: str  # name of the learner
    init: str = SCRATCH  # "scratch" or "imitation", whose hyperparameters are used
    timesteps: int | None = None  # time steps; None: the learner's own number
    # what distinguishes a policy -> its file in the training's folder
    files: Mapping[str, str] = dataclasses.field(default_factory=lambda: {"": BEST})
    _: dataclasses.KW_ONLY
    start: Other | None = None  # the policy with which the training begins; None: that of `init`
    expert: Other | None = None  # the policy that it imitates, if it does; None: the usual law
    startup: bool = False  # whether it imitates the policy near its own gait only
    # that differ from the learner's own
    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    # fields of `agents.imitation.Cloning` that differ from its own
    cloning: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    prior: str | None = None  # of the training; its hyperparameters are then those with a prior
    period: float = CONTROL_PERIOD  # how long its policies hold an action (s)

    @property
    def needs(self) -> tuple[StudyRow, ...]:
        """Rows whose policies it needs."""
        return tuple(each.row for each in (self.start, self.expert) if each)

    def run(self, seed: int, folder: Path, others: Mapping[str, Path], by: Protocol) -> SeedResult:
        """Train, or go on from the last state, and evaluate.

        CMA-ES leaves a policy as it is that does not walk.
        """
        cache = folder.parent / CACHE
        start = self.init
        if self.start is not None:
            start = str(others[self.start.row.name] / self.start.file)
        config = TrainingConfig(
            self.algo,
            start,
            seed,
            timesteps=self.timesteps,
            params=BUILDABLE,
            hyperparameters=self.hyperparameters,
            prior=self.prior,
            **self._environment(),
        )
        if self.init == IMITATION and self.start is None:
            expert = EXPERT
            if self.expert is not None:
                expert = str(others[self.expert.row.name] / self.expert.file)
            config = dataclasses.replace(
                config, expert=expert, startup=self.startup, cloning=self.cloning
            )
        try:
            trained = train(config, folder, cache=cache, progress=False)
        except DoesNotWalkError:
            if self.start is None:
                raise
            return SeedResult(self.evaluate(dict.fromkeys(self.files, Path(start)), by), 0, 0.0)
        files = {name: folder / file for name, file in self.files.items()}
        minutes = trained.curve[-1].minutes
        return SeedResult(self.evaluate(files, by), trained.timesteps, minutes)

    def _environment(self) -> dict[str, Any]:
        """Arguments of the training that choose the environment."""
        return {}

    def evaluate(self, files: Mapping[str, Path], by: Protocol) -> Policies:
        """Every policy by the protocol."""
        return {
            name: WalkFigures.of(evaluate(load_policy(file, BUILDABLE).policy, BUILDABLE, by))
            for name, file in files.items()
        }


@dataclasses.dataclass(frozen=True)
class Following(Trained):
    """A training on `RimlessWheelSpeed-v0`, evaluated at constant commands and as they change."""

    speeds: tuple[float, float] = SPEEDS  # between which one is commanded in training (m/s)
    commands: tuple[float, ...] = ()  # that stay for the whole walk (m/s)
    changes: tuple[float, ...] = ()  # one after the other, every 10 s, in one walk (m/s)

    def _environment(self) -> dict[str, Any]:
        return {"speeds": self.speeds, "control_period": self.period}

    def evaluate(self, files: Mapping[str, Path], by: Protocol) -> Policies:
        """The policy at every command."""
        (file,) = files.values()
        policy, period = load_policy(file, BUILDABLE).policy, self.period
        walks = evaluate_commanded(policy, self.commands, BUILDABLE, by, control_period=period)
        each = zip(self.commands, walks, strict=True)
        policies = {f"{command:g} m/s": WalkFigures.of(evaluation) for command, evaluation in each}
        if not self.changes:
            return policies
        stretches = walk_through(policy, self.changes, by, control_period=period)
        for (before, _), (command, figures) in itertools.pairwise(stretches):
            policies[f"{command:g} m/s after {before:g}"] = figures
        return policies


def walk_through(
    policy: Policy,
    commands: Sequence[float],
    by: Protocol,
    *,
    seconds: float = 10.0,
    control_period: float = PERIOD,
) -> list[tuple[float, WalkFigures]]:
    """How a policy walks on while the command changes: (command, figures) of each.

    A command is measured in the second half of the time that it lasts. Falls are those that have
    happened then or before.

    Args:
        policy: is given observations (N, 8).
        commands: the speeds (m/s), one after the other.
        by: whose starts it walks from.
        seconds: for which each command lasts; the first lasts twice as long, to get going.
        control_period: for which an action is held (s).
    """
    conditions = Conditions.of(BUILDABLE, None, None, SPEEDS, control_period)
    each = round(seconds / control_period)
    starts = draw_starts(BUILDABLE, by.starts, by.seed)
    n_intervals = (len(commands) + 1) * each
    walks = Rollout(conditions, policy, starts, n_intervals, by.seed, command=commands[0])
    fallen, stretches = np.zeros(len(starts), dtype=bool), list[tuple[float, WalkFigures]]()
    for k, interval in enumerate(walks):
        fallen[interval.running] = interval.info["failure"] != OK
        stretch, into = divmod(k - each, each)
        if stretch < 0:
            continue
        if into == each // 2:
            window, steps = WindowTotals(walks.machines), np.zeros(len(starts))
        if into >= each // 2:
            window.add(interval)
            steps[interval.running] += interval.info["steps"]
        if into == each - 1:
            figures = _figures(outcomes(fallen, steps > 0, window), window)
            stretches.append((commands[stretch], figures))
            if stretch + 1 < len(commands):
                walks.command(commands[stretch + 1])
    all_fell = WalkFigures(0.0, 1.0, 0.0, math.nan, math.nan)
    return stretches + [(command, all_fell) for command in commands[len(stretches) :]]


def _figures(results: Sequence[str], window: WindowTotals) -> WalkFigures:
    walking = np.array([each == WALKS for each in results])
    speed = cot = math.nan
    if walking.any():
        ledger, weighted = window.total(walking, window.machines[0])
        speed, cot = ledger.distance / ledger.time, weighted.cost_of_transport(window.machines[0])
    fallen, slipping = (float(np.isin(results, kinds).mean()) for kinds in ((FALLS,), SLIPS))
    return WalkFigures(float(walking.mean()), fallen, slipping, cot, speed)
