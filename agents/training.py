"""Training a learner, from scratch, from a clone of an expert, or from a policy."""

from __future__ import annotations

import dataclasses
import io
import math
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from agents.evaluate import Evaluation, evaluate
from agents.experts import expert_policy, fitting_policy
from agents.gaps import gap_to_continuous_optimum
from agents.learner import (
    BEST,
    CLONE,
    IMITATION,
    INITS,
    LAST,
    Learner,
    PolicyParts,
    Training,
    learner_class,
)
from agents.policy_files import (
    LAW_ACTIONS,
    LAW_STATES,
    NOTHING,
    CheckpointError,
    TrainingEffort,
    read_record,
    save_policy,
)
from agents.prior import LAW, law_prior
from agents.reward_weight import economy
from agents.rollout import Policy, learned_policy
from agents.training_config import TrainingConfig
from rimless_gym.checks import extra
from trajopt.feedback import laws
from trajopt.pool import progress_bar
from trajopt.store import Store, jsonable, write_bytes

with extra("learn"):
    import torch
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

#: What a training leaves in its folder, besides policies and TensorBoard's events: what it is, and
#: all that it needs to go on.
IDENTITY, STATE = "train.json", "state.pt"

#: Evaluations of a training, besides the one at its start. After each, its state is saved.
EVALUATIONS = 20


class DivergedError(ValueError):
    """The weights of a training are infinite, or far too large."""


@dataclasses.dataclass(frozen=True)
class Milestone:
    """A periodic evaluation of a training: a point of its learning curve.

    Attributes:
        intervals: control intervals so far, all environments together.
        minutes: of one core so far, those before a stop included.
        walking_share: of the starts, in [0, 1].
        speed: of those that walk (m/s); NaN if none does.
        cot: of those that walk; NaN if none does.
        objective: mean reward per second over all starts (m/s).
    """

    intervals: int
    minutes: float
    walking_share: float
    speed: float
    cot: float
    objective: float


@dataclasses.dataclass(frozen=True)
class TrainResult:
    """What a training left in its folder.

    Attributes:
        best: file of the policy that did best in the periodic evaluations.
        last: file of the policy as it is now.
        clone: file of the clone that it began with, if any.
        timesteps: environment steps so far.
        curve: all evaluations, those of earlier calls included.
    """

    best: Path
    last: Path
    clone: Path | None
    timesteps: int
    curve: tuple[Milestone, ...]


def reward_per_second(evaluation: Evaluation) -> float:
    """The reward alone, as a score."""
    return evaluation.objective


def walking_economy(evaluation: Evaluation) -> float:
    """The score by which the best policy is chosen, unless another is given."""
    return economy(evaluation.walking_share, evaluation.cot)


def train(
    config: TrainingConfig,
    out: str | Path = "runs/train",
    *,
    cache: Path | None = None,
    progress: bool = True,
) -> TrainResult:
    """Train a policy into a folder: best.zip, last.zip, train.json, state.pt, TensorBoard events.

    The state of the training is saved after each evaluation. However it was stopped, the same call
    goes on from the last state and ends with the same policy as without a stop. Ctrl-C and SIGTERM
    stop it after the current iteration of the learner, and save its state.

    Args:
        config: what to train.
        out: folder; new, or that of the same training. Experts and priors that are objects,
            `score` and `protocol` are not compared.
        cache: folder of the experts' gaits and start-up controllers, which other trainings use too.
        progress: whether to show progress on a terminal.

    Raises:
        ValueError: an argument is out of range, `out` holds another training, or its state is
            damaged.
        TypeError: an argument is of the wrong kind.
        CheckpointError: a policy to start from does not fit.
        DoesNotWalkError: a policy to start from, or to imitate with a start-up controller, does not
            walk; or evolution finds none that does.
        OSError: the disk is full, or `out` cannot be written; the last state is kept.
        KeyboardInterrupt: the training was stopped.
    """
    out, training = Path(out), config.training()
    store, resumes = Store(out, training.identity, IDENTITY), (out / STATE).exists()
    store.check()
    start = None if resumes or config.init in INITS else _start(config, training)
    if training.prior == LAW:
        prior = law_prior(training.conditions, training.task, cache, progress)
        training = dataclasses.replace(training, prior=prior)
    learner = learner_class(training.algo)(training, start)
    try:
        expert = None
        if not resumes and config.init == IMITATION:
            expert = expert_policy(
                config.expert, training.conditions, cache, progress, startup=config.startup
            )
        with store:  # what is refused above claims no folder
            trainer = Trainer(config, training, learner, out, progress)
            try:
                if expert is not None:
                    trainer.imitate(expert)
                trainer.run()
            finally:
                trainer.close()
            return trainer.result()
    finally:
        learner.close()


def _start(config: TrainingConfig, training: Training) -> PolicyParts:
    """The policy in the file from which a training begins."""
    start = fitting_policy(config.init, training.conditions)
    if not issubclass(learner_class(training.algo), learner_class(start.algo)):
        raise CheckpointError(
            f"{config.init}: a policy of {start.algo}, which cannot start {training.algo}; use one "
            f"of {training.algo}"
        )
    return start.parts


class Trainer:
    """One run of a training; the `agents.learner.Callback` of its learner.

    If the folder has a state, the training goes on from there.

    Attributes:
        log: for the learner's figures.
        stopped: whether to stop at the end of this iteration.
    """

    def __init__(
        self,
        config: TrainingConfig,
        training: Training,
        learner: Learner,
        out: Path,
        progress: bool,
    ) -> None:
        self._config, self._training, self._learner = config, training, learner
        self._out, self._progress = out, progress
        default = reward_per_second if training.conditions.commanded else walking_economy
        self._score = config.score or default
        self._total = training.settings.n_timesteps
        if config.timesteps is not None:
            self._total = config.timesteps
        self._best, self._due, self._over = -math.inf, 0, -1
        self._minutes_before, self._began_at = 0.0, time.process_time()
        self._curve: list[Milestone] = []
        self._before, self._curve_before = _what_came_before(config)
        self._labels = 0
        if (out / CLONE).exists():
            self._labels = read_record(out / CLONE)["cloning"]["samples"]
        if (out / STATE).exists():
            self._restore()
        self.stopped = False
        self.log = Logger(str(out), [TensorBoardOutputFormat(str(out))])
        self._bar = progress_bar(
            f"{training.algo} {config.init if config.init in INITS else 'from a policy'}",
            progress,
            total=self._total,
            initial=min(learner.steps, self._total),
            unit="step",
            unit_scale=True,
        )

    def imitate(self, expert: Policy) -> None:
        """Clone the expert."""
        cloning = self._config.how_to_clone
        report = self._learner.imitate(expert, cloning, self._progress)
        self._labels = report.samples
        self._save_policy(CLONE, cloning=dataclasses.asdict(report))

    def run(self) -> None:
        """Learn to the end.

        Raises:
            KeyboardInterrupt: the training was stopped.
            DivergedError: the training has diverged.
        """
        if self._over >= self._total:
            return
        try:
            with _stopped_by_signals(self):
                self._learner.learn(self._total, self)
        except ValueError as error:
            if "Expected parameter" in str(error):  # PyTorch's, of a distribution that is none
                raise self._divergence() from error
            raise
        self._evaluate()
        self._over = self._total
        self._save()

    def result(self) -> TrainResult:
        """What is in the folder now."""
        out = self._out
        return TrainResult(
            best=out / BEST,
            last=out / LAST,
            clone=out / CLONE if (out / CLONE).exists() else None,
            timesteps=self._learner.steps,
            curve=tuple(self._curve),
        )

    def on_iteration(self) -> None:
        """See `agents.learner.Callback`."""
        due = self._learner.steps >= self._due
        if due:
            self._evaluate()
        if due or self.stopped:
            self._save()
        if self.stopped:
            steps = self._learner.steps
            raise KeyboardInterrupt(f"{steps} steps are kept; the same command continues")

    def on_step(self) -> None:
        """See `agents.learner.Callback`."""
        self._bar.update(min(self._learner.steps, self._bar.total) - self._bar.n)

    def on_phase(self, name: str) -> None:
        """See `agents.learner.Callback`."""
        self._bar.set_postfix_str(name)

    def close(self) -> None:
        """Close the log and leave the progress bar as it is."""
        self._bar.close()
        self.log.close()

    def _evaluate(self) -> None:
        """Evaluate the policy, log its figures, and keep it if it is the best so far."""
        self._require_finite()
        conditions, steps = self._training.conditions, self._learner.steps
        self._due = steps + max(1, math.ceil(self._total / EVALUATIONS))
        protocol, speeds = self._config.protocol, conditions.control.speeds
        evaluation = evaluate(
            learned_policy(self._learner.act),
            conditions.params,
            protocol,
            task=self._training.task,
            progress=self._progress,
            ranges=conditions.ranges,
            disturbances=conditions.disturbances,
            command=None if speeds is None else np.linspace(*speeds, protocol.starts),
            control_period=conditions.control.period,
        )
        figures = {
            name: float(getattr(evaluation, name))
            for name in ("walking_share", "speed", "cot", "objective")
        }
        intervals = steps * self._training.settings.intervals_per_step
        self._curve.append(Milestone(intervals, self._minutes, **figures))
        score = float(self._score(evaluation))
        if math.isnan(score):  # such as the cost of transport of a policy that does not walk
            score = -math.inf
        if score > self._best or not (self._out / BEST).exists():
            self._best = score
            self._save_policy(BEST, score=score, evaluation=evaluation.to_dict())
        figures |= {
            "cot_with_regeneration": evaluation.cot_with_regeneration,
            "gap_to_continuous_optimum": gap_to_continuous_optimum(evaluation, conditions),
            "best_score": self._best,
        }
        for name, value in figures.items():
            if math.isfinite(value):  # without a walk there is no speed
                self.log.record(f"eval/{name}", value)
        self.log.dump(steps)

    @property
    def _minutes(self) -> float:
        return self._minutes_before + (time.process_time() - self._began_at) / 60.0

    def _save(self) -> None:
        """Write the policy, and all that the training needs to go on."""
        self._require_finite()
        self._save_policy(LAST)
        state = self._learner.state()
        if state is None:
            return
        saved = {
            "learner": state,
            "best": self._best,
            "due": self._due,
            "over": self._over,
            "minutes": self._minutes,
            "curve": [dataclasses.asdict(milestone) for milestone in self._curve],
        }
        write_state(self._out / STATE, saved)

    def _restore(self) -> None:
        """Go on from the saved state."""
        path = self._out / STATE
        try:
            state = read_state(path)
            self._learner.restore(state["learner"])
            self._best, self._due, self._over = state["best"], state["due"], state["over"]
            self._minutes_before = state["minutes"]
            self._curve = [Milestone(**each) for each in state["curve"]]
        except Exception as error:  # torch and learners may raise anything
            raise ValueError(
                f"{path}: damaged, or of other versions ({error!r}); go on with these, or choose "
                f"another folder to train anew; policies in {self._out} can still be used"
            ) from error

    def _save_policy(self, name: str, **notes: Any) -> None:
        if self._learner.parts() is not None:
            notes |= self._effort()
            save_policy(self._out / name, self._training, self._learner, **notes)

    def _effort(self) -> dict[str, Any]:
        """The `TrainingEffort` so far, and the learning curve with what came before added."""
        prior, intervals, minutes = self._before
        done = self._learner.steps * self._training.settings.intervals_per_step + self._labels
        effort = TrainingEffort(
            prior,
            None if intervals is None else intervals + done,
            None if minutes is None else minutes + self._minutes,
        )
        curve = [
            dataclasses.asdict(each)
            | {
                "intervals": each.intervals + self._labels + (intervals or 0),
                "minutes": each.minutes + (minutes or 0.0),
            }
            for each in self._curve
        ]
        return {**effort._asdict(), "curve": [*self._curve_before, *jsonable(curve)]}

    def _require_finite(self) -> None:
        """Stop before a policy that is of no use is written over a good one."""
        parts = self._learner.parts()
        if parts and not all(np.isfinite(each).all() for each in parts.weights.values()):
            raise self._divergence()

    def _divergence(self) -> DivergedError:
        return DivergedError(
            f"the training has diverged: after {self._learner.steps} steps its weights are "
            f"infinite or far too large; {self._out} keeps what they were before. Begin anew with "
            "another --out and a smaller learning_rate (--settings)"
        )


def _what_came_before(config: TrainingConfig) -> tuple[TrainingEffort, list[dict[str, Any]]]:
    """Effort and learning curve of the policy from which a training begins, or that it imitates."""
    source, curve = config.expert if config.init == IMITATION else config.init, []
    if not isinstance(source, str) or source in (*INITS, *laws.names()):
        before = TrainingEffort(LAW_ACTIONS if config.init == IMITATION else NOTHING, 0, 0.0)
    else:
        record = read_record(source)
        before, curve = TrainingEffort.of(record), record.get("curve", [])
    return before if config.prior is None else before._replace(prior=LAW_STATES), curve


@contextmanager
def _stopped_by_signals(trainer: Trainer) -> Iterator[None]:
    """Within the block, Ctrl-C and SIGTERM stop the trainer; a second one stops it at once."""

    def stop(number: int, frame: FrameType | None) -> None:
        if trainer.stopped:
            raise KeyboardInterrupt
        trainer.stopped = True

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, before in former.items():
            signal.signal(number, before)


def write_state(path: Path, state: dict[str, Any]) -> None:
    """Write nested plain values, arrays and tensors; the file is complete or left as it was."""
    buffer = io.BytesIO()
    torch.save(_with_tensors(state), buffer)
    write_bytes(path, buffer.getvalue())


def read_state(path: Path) -> dict[str, Any]:
    """What `write_state` wrote, with lists for tuples; no code in the file is run."""
    return dict(_with_arrays(torch.load(path, weights_only=True)))


#: Marks a tensor that was an array.
_ARRAY = "numpy array"


def _with_tensors(tree: Any) -> Any:
    match tree:
        case np.ndarray():
            return {_ARRAY: torch.from_numpy(np.ascontiguousarray(tree))}
        case np.generic():
            return tree.item()
        case Mapping():
            return {key: _with_tensors(each) for key, each in tree.items()}
        case list() | tuple() | deque():
            return [_with_tensors(each) for each in tree]
    return tree


def _with_arrays(tree: Any) -> Any:
    match tree:
        case {"numpy array": tensor}:
            return tensor.numpy()
        case dict():
            return {key: _with_arrays(each) for key, each in tree.items()}
        case list():
            return [_with_arrays(each) for each in tree]
    return tree
