"""Behaviour cloning by DAgger: an expert labels walks, and a network learns from them.

The first round learns from the expert's own walks. In the later ones the clone walks and the expert
labels the states with what it would have done (Ross, Gordon and Bagnell, AISTATS 2011), so that the
clone learns to correct its own mistakes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.rollout import Act, Policy, Rollout, begun, draw_starts, learned_policy
from rimless_gym.checks import as_instance, extra, integer, positive, real
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats
from trajopt.pool import progress_bar

with extra("learn"):
    import torch
    from torch import nn

#: Observations (M, 6) and actions (M,), float32.
Labelled: TypeAlias = tuple[torch.Tensor, torch.Tensor]

#: How long a commanded speed lasts in these walks (s); the next one is drawn anew.
COMMAND_LASTS = 3.0


@dataclasses.dataclass(frozen=True)
class Cloning:
    """How to clone.

    Attributes:
        rounds: of DAgger, the expert's own included.
        expert_starts: random starts that the expert walks from in the first round.
        seconds: length of each walk (s).
        starts: random starts that the clone walks from in each later round.
        labels: states of these walks that the expert labels, per round.
        lost_labels: at most so many more, of those walks in which the wheel falls.
        gait_starts: starts of the clone among the states of the second half of the expert's walks:
            the cost of transport is decided near the gait.
        gait_labels: states of these walks that the expert labels, per round.
        gradient_steps: in each round; twice as many in the last.
        batch_size: observations per gradient step.
        huber: error (in units of the voltage limit) above which the loss grows only linearly: no
            smooth network follows the expert's switches, and trying costs accuracy elsewhere.
        learning_rate: at the beginning; it falls to 0 along a cosine over all rounds.
        log_std: natural logarithm of the cloned policy's exploration noise.
        held_out: share of the walks that is not learned from but measures the error.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a number is out of its range.
    """

    rounds: int = 8
    expert_starts: int = 64
    seconds: float = 6.0
    starts: int = 256
    labels: int = 60_000
    lost_labels: int = 0
    gait_starts: int = 64
    gait_labels: int = 24_000
    gradient_steps: int = 4000
    batch_size: int = 512
    learning_rate: float = 2e-3
    huber: float = 0.05
    log_std: float = -4.5
    held_out: float = 0.1

    def __post_init__(self) -> None:
        integer("expert_starts", self.expert_starts, 2)  # one to learn from, one held out
        for name in ("rounds", "starts", "gait_starts", "batch_size"):
            integer(name, getattr(self, name), 1)
        for name in ("labels", "lost_labels", "gait_labels", "gradient_steps"):
            integer(name, getattr(self, name), 0)
        for name in ("seconds", "learning_rate", "huber"):
            positive(name, getattr(self, name))
        real("log_std", self.log_std)
        if not 0 < real("held_out", self.held_out) <= 0.5:
            raise ValueError(f"held_out = {self.held_out}: must be greater than 0, at most 0.5")


#: How to clone a policy and its start-up controller. The gait of a policy may be only just stable,
#: and its clone unstable: one that falls after 10 to 20 s has to walk so long to learn from it.
LASTING = Cloning(seconds=15.0, labels=90_000, gait_labels=48_000)


def as_cloning(
    cloning: Cloning | Mapping[str, Any] | None, usual: Cloning | None = None
) -> Cloning:
    """How to clone, given as such or as a mapping of fields that differ; None: as usual."""
    usual = usual or Cloning()
    if isinstance(cloning, Mapping):
        cloning = {**dataclasses.asdict(usual), **cloning}
    checked: Cloning = as_instance(Cloning, "cloning", cloning, usual)
    return checked


class Student(Protocol):
    """What learns to act as an expert does, such as `agents.sb3.learner.Actor`.

    Functions are properties here because some students have them as fields.
    """

    @property
    def weights(self) -> list[nn.Parameter]:
        """Of the mean action."""

    @property
    def act(self) -> Act:
        """The deterministic policy as it is now."""

    @property
    def mean_action(self) -> Callable[[torch.Tensor], torch.Tensor]:
        """Observations (N, size) -> the deterministic actions (N,), differentiable."""

    @property
    def set_noise(self) -> Callable[[float], None]:
        """Takes the natural logarithm of the exploration noise's standard deviation."""


@dataclasses.dataclass(frozen=True)
class CloneReport:
    """How a cloning went."""

    samples: int  # labelled observations, all rounds together
    # root-mean-square error on walks held out (voltage limits), after each round
    errors: tuple[float, ...]


def clone(student: Student, teaching: Teaching, progress: bool = True) -> CloneReport:
    """Train a student to act as an expert does, in place.

    Raises:
        ValueError: all of the expert's walks end soon.
    """
    config = teaching.config
    rng = np.random.default_rng((teaching.seed, 1))
    total = (config.rounds + 1) * config.gradient_steps
    optimizer = torch.optim.Adam(student.weights, lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, total)
    walks: list[LabelledWalks] = []
    errors: list[float] = []
    with progress_bar("clone", progress, total=total, leave=False) as bar:
        for k in range(config.rounds):
            if k == 0:
                walks.append(teaching.first_round())
            else:
                walks.extend(teaching.later_round(k, walks[0], student.act, rng))
            learned, held_out = _split(walks, config.held_out)
            for _ in range(config.gradient_steps * (2 if k == config.rounds - 1 else 1)):
                batch = torch.from_numpy(rng.integers(len(learned[1]), size=config.batch_size))
                loss = nn.functional.huber_loss(
                    student.mean_action(learned[0][batch]), learned[1][batch], delta=config.huber
                )
                optimizer.zero_grad(set_to_none=True)
                loss.backward()
                optimizer.step()
                schedule.step()
                bar.update()
            with torch.no_grad():
                error = nn.functional.mse_loss(student.mean_action(held_out[0]), held_out[1]).sqrt()
            errors.append(float(error))
            bar.set_postfix(error=f"{errors[-1]:.4f}")
    student.set_noise(config.log_std)
    return CloneReport(sum(len(walk.when) for walk in walks), tuple(errors))


def _split(walks: list[LabelledWalks], held_out: float) -> tuple[Labelled, Labelled]:
    """Observations and actions to learn from, and those of one start in every 1 / held_out."""
    tested = np.concatenate([walk.which % round(1 / held_out) == 0 for walk in walks])
    observations = np.concatenate([walk.observations for walk in walks])
    actions = np.concatenate([walk.actions for walk in walks]).astype(np.float32)
    learned, held = (
        (torch.from_numpy(observations[part]), torch.from_numpy(actions[part]))
        for part in (~tested, tested)
    )
    return learned, held


class LabelledWalks(NamedTuple):
    """Control intervals of several walks, one after the other."""

    machines: tuple[WheelParams, ...]  # of each start
    which: NDArray[np.int64]  # index of the start, (M,)
    when: NDArray[np.int64]  # index of the interval, (M,)
    states: Floats  # (M, STATE_SIZE)
    observations: NDArray[np.float32]  # (M, 6); (M, 8) where a speed is commanded
    actions: Floats  # in units of the voltage limit, (M,)

    def take(self, indices: NDArray[np.int64]) -> LabelledWalks:
        """Some of the intervals."""
        arrays = (values[indices] for values in self[1:])
        return LabelledWalks._make((self.machines, *arrays))


def walk(
    conditions: Conditions,
    policy: Policy,
    starts: Floats,
    n_intervals: int,
    seed: int = 0,
    command_lasts: float = COMMAND_LASTS,
) -> LabelledWalks:
    """States and actions of a policy from `starts` (N, STATE_SIZE); see `Rollout`.

    Where a speed is commanded, it changes whenever it has lasted for `command_lasts` (s): so a
    clone meets all changes of command.
    """
    rollout = Rollout(conditions, policy, starts, n_intervals, seed)
    intervals, rng = [], np.random.default_rng((seed, 5))
    lasting = round(command_lasts / conditions.control.period)
    for k, interval in enumerate(rollout, start=1):
        intervals.append(interval)
        if conditions.control.speeds is not None and k % lasting == 0:
            rollout.command(rng.uniform(*conditions.control.speeds, size=len(starts)))
    return LabelledWalks(
        machines=rollout.machines,
        which=np.concatenate([interval.running for interval in intervals]),
        when=np.repeat(np.arange(len(intervals)), [len(i.running) for i in intervals]),
        states=np.concatenate([interval.states for interval in intervals]),
        observations=np.concatenate([interval.observations for interval in intervals]),
        actions=np.concatenate([interval.actions for interval in intervals]),
    )


@dataclasses.dataclass(frozen=True)
class Teaching:
    """An expert, and where and how it teaches."""

    expert: Policy  # to be imitated
    # of all walks. A feedback law labels true states even where sensors are noisy
    conditions: Conditions
    config: Cloning  # how to clone
    seed: int  # of the starts, and of what the conditions draw

    def first_round(self) -> LabelledWalks:
        """The expert's own walks."""
        starts = draw_starts(self.conditions.params, self.config.expert_starts, (self.seed, 2))
        return self.walks(self.expert, starts, (self.seed, 3))

    def later_round(
        self, k: int, first: LabelledWalks, act: Act, rng: np.random.Generator
    ) -> list[LabelledWalks]:
        """States of the clone's walks with the expert's actions: from anywhere, and near the gait.

        Those near the gait begin in the second half of the walks of the `first` round.

        Raises:
            ValueError: no walk of the `first` round lasts that long.
        """
        config, clone = self.config, learned_policy(act)
        gait = first.states[first.when >= self._n_intervals // 2]
        if not len(gait):
            half = f"{config.seconds / 2:g} s"
            raise ValueError(f"expert: all of its walks end within {half}; take one that walks")
        anywhere = draw_starts(self.conditions.params, config.starts, (self.seed, 2, k))
        near = gait[rng.integers(len(gait), size=config.gait_starts)]
        ordinary = self.walks(clone, anywhere, (self.seed, 3, k))
        labelled = [
            self._labelled(ordinary, config.labels, rng),
            self._labelled(self.walks(clone, near, (self.seed, 4, k)), config.gait_labels, rng),
        ]
        if config.lost_labels:
            fallen = np.bincount(ordinary.which, minlength=config.starts) < self._n_intervals
            lost = ordinary.take(np.flatnonzero(fallen[ordinary.which]))
            labelled.append(self._labelled(lost, config.lost_labels, rng))
        return labelled

    @property
    def _n_intervals(self) -> int:
        return round(self.config.seconds / self.conditions.control.period)

    def walks(self, policy: Policy, starts: Floats, seed: tuple[int, ...]) -> LabelledWalks:
        """Whole walks from these starts."""
        number = int(np.random.SeedSequence(seed).generate_state(1)[0])
        return walk(self.conditions, policy, starts, self._n_intervals, number)

    def _labelled(self, seen: LabelledWalks, count: int, rng: np.random.Generator) -> LabelledWalks:
        """Some of the intervals, with the expert's actions."""
        some = seen.take(rng.permutation(len(seen.when))[:count])
        expert = begun(self.expert, some.machines, lambda: some.which)
        return some._replace(actions=expert(some.states, some.observations))
