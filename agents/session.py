"""What goes on around a learner while it learns: evaluation, saving, stopping, a progress bar."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.evaluate import Evaluation, evaluate
from agents.film import film
from agents.folder import BEST, CLONING, LAST, STATE
from agents.gaps import gap_to_continuous_optimum
from agents.interrupts import StopRequest
from agents.learner import Learner
from agents.logs import EventLog
from agents.milestones import Milestone
from agents.policies import learned_policy
from agents.policy_files import save_policy
from agents.protocol import Protocol
from agents.recording import record
from agents.rollout import Rollout, at_rest
from agents.training import INITS, Training
from agents.training_state import write_state
from rimless_gym.envs.arguments import Control
from trajopt.feedback.law import Floats

#: Seconds between two saved states of a training: as much is lost if it is killed.
SAVE_INTERVAL = 30.0

#: Evaluations of a training, besides the one at its start.
EVALUATIONS = 20

#: Seconds of a film of the best policy; its pictures per second, and their size in pixels.
FILMED, FPS, PICTURE = 6.0, 10, (300, 180)


@dataclasses.dataclass
class Standing:
    """How far a training has come, apart from the state of its learner.

    Attributes:
        best: the best score so far.
        due: steps at which the next evaluation is due; None: at once.
        over: steps that were asked for when it last came to its end; None if it never has.
        logged: figures that are recorded but not yet written to the log.
        curve: the evaluations so far.

    Raises:
        TypeError: a value is of the wrong kind.
    """

    best: float = -math.inf
    due: int | None = None
    over: int | None = None
    logged: dict[str, Any] = dataclasses.field(default_factory=dict)
    curve: list[Milestone] = dataclasses.field(default_factory=list)

    @classmethod
    def read(cls, values: dict[str, Any]) -> Standing:
        """From `dataclasses.asdict`.

        Raises:
            TypeError: a value is missing or of the wrong kind.
        """
        curve = [Milestone(**each) for each in values["curve"]]
        return cls(**values | {"curve": curve})

    def __post_init__(self) -> None:
        steps = [step for step in (self.due, self.over) if step is not None]
        if not (type(self.best) is float and all(type(step) is int for step in steps)):
            raise TypeError(f"{self}: a score must be a float, and steps must be integers")
        self.logged = dict(self.logged)


@dataclasses.dataclass(frozen=True)
class Plan:
    """What a call of `train` is to do.

    Attributes:
        training: what is learned.
        out: folder.
        total: steps after which it is over.
        score: of an evaluation; the policy with the largest is kept as the best.
        protocol: of the periodic evaluations.
        progress: whether to show a progress bar.
        minutes: tells the minutes of one core that the training has taken so far.
        plans: folder in which the plans of feedback laws are kept; None: nowhere.
    """

    training: Training
    out: Path
    total: int
    score: Callable[[Evaluation], float]
    protocol: Protocol
    progress: bool
    minutes: Callable[[], float]
    plans: Path | None = None


class Session:
    """One run of a training, from its beginning or its last state until it is over or stopped.

    It is the `agents.learner.Watch` that the learner is given.

    Args:
        plan: what to do.
        learner: in the state from which to go on.
        standing: how far it has come.
        stop: the request to stop.

    Attributes:
        log: for the learner's figures.
        kept: steps in the state that was saved last.
        evaluations: (steps, evaluation) pairs.
    """

    def __init__(self, plan: Plan, learner: Learner, standing: Standing, stop: StopRequest) -> None:
        self._plan, self._learner, self._standing, self._stop = plan, learner, standing, stop
        self._saved_at = -math.inf
        self.kept = learner.steps
        self.evaluations: list[tuple[int, Evaluation]] = []
        self.log = EventLog(plan.out, learner.steps)
        for name, value in standing.logged.items():
            self.log.record(name, value)
        self._bar = tqdm(
            total=plan.total,
            initial=min(learner.steps, plan.total),
            desc=f"{plan.training.algo} {_named(plan.training.init)}",
            unit="step",
            unit_scale=True,
            disable=not plan.progress,
        )

    def run(self) -> None:
        """Learn until the plan's end.

        Raises:
            KeyboardInterrupt: somebody asked to stop before it was reached.
            ValueError: the training has diverged.
        """
        try:
            self._learner.learn(self._plan.total, self)
        except ValueError as error:
            if "Expected parameter" in str(error):  # PyTorch's, of a distribution that is none
                raise self._divergence() from error
            raise
        self._evaluate()
        self.log.dump(self._learner.steps)
        self._standing.over = self._plan.total
        self._save()

    def between(self) -> None:
        """See `agents.learner.Watch`."""
        due = self._standing.due
        evaluated = due is None or self._learner.steps >= due
        if evaluated:
            self._evaluate()
        if evaluated or self._stop.made or time.monotonic() - self._saved_at > SAVE_INTERVAL:
            self._save()
        if self._stop.made:
            raise KeyboardInterrupt

    def advanced(self) -> None:
        """See `agents.learner.Watch`."""
        self._bar.update(min(self._learner.steps, self._bar.total) - self._bar.n)

    def doing(self, what: str) -> None:
        """See `agents.learner.Watch`."""
        self._bar.set_postfix_str(what)

    def close(self) -> None:
        """Close the log and leave the progress bar as it stands."""
        self._bar.close()
        self.log.close()

    def _require_finite(self) -> None:
        """Stop before a policy that is of no use is written over a good one.

        Raises:
            ValueError: the training has diverged.
        """
        weights = self._learner.parts().weights.values()
        if not all(np.isfinite(each).all() for each in weights):
            raise self._divergence()

    def _divergence(self) -> ValueError:
        return ValueError(
            f"the training has diverged: after {self._learner.steps} steps its weights are "
            f"infinite or far too large; {self._plan.out} keeps what they were after {self.kept}. "
            "Begin anew with another --out and a smaller learning_rate (--settings)"
        )

    def _evaluate(self) -> None:
        self._require_finite()
        plan, steps = self._plan, self._learner.steps
        conditions = plan.training.conditions
        self._standing.due = steps + max(1, math.ceil(plan.total / EVALUATIONS))
        result = evaluate(
            learned_policy(self._learner.act),
            conditions.params,
            plan.protocol,
            task=plan.training.task,
            ranges=conditions.ranges,
            disturbances=conditions.disturbances,
            command=_commands(conditions.control, plan.protocol.starts),
            control_period=conditions.control.period,
        )
        self.evaluations.append((steps, result))
        intervals = steps * plan.training.settings.intervals_per_step
        self._standing.curve.append(Milestone.of(result, intervals, plan.minutes()))
        for name in ("walking_share", "speed", "cot", "cot_with_regeneration", "objective"):
            self._record(f"eval/{name}", getattr(result, name))
        gap = gap_to_continuous_optimum(result, conditions)
        self._record("eval/gap_to_continuous_optimum", gap)
        score = float(plan.score(result))
        if math.isnan(score):  # such as the cost of transport of a policy that does not walk
            score = -math.inf
        if score > self._standing.best or not (plan.out / BEST).exists():
            self._standing.best = score
            notes = {"score": score, "evaluation": result.to_dict()}
            save_policy(plan.out / BEST, plan.training, self._learner, **notes)
            if result.walking_share > 0.0:
                self._film()
        self._record("eval/best_score", self._standing.best)

    def _film(self) -> None:
        """Log how the policy walks from rest."""
        conditions = self._plan.training.conditions
        period, speeds = conditions.control.period, conditions.control.speeds
        walk = Rollout(
            conditions,
            learned_policy(self._learner.act),
            at_rest(conditions.params)[None],
            round(FILMED / period),
            command=None if speeds is None else float(np.mean(speeds)),
        )
        kept = record("from rest", walk, walk.machines[0], period)
        frames = list(film(kept, fps=FPS, size=PICTURE))
        self.log.film("eval/from_rest", frames, FPS, self._learner.steps)

    def _record(self, name: str, value: float) -> None:
        """Log a figure, unless there is none, such as the speed where nothing walks."""
        if math.isfinite(value):
            self.log.record(name, value)

    def _save(self) -> None:
        """Write the training as it is now."""
        self._require_finite()
        out, training = self._plan.out, self._plan.training
        self._standing.logged = dict(self.log.name_to_value)
        with self._stop.held_off():
            save_policy(out / LAST, training, self._learner)
            state = {
                "identity": training.identity,
                "standing": dataclasses.asdict(self._standing),
                "learner": self._learner.state(),
            }
            write_state(out / STATE, state)
            (out / CLONING).unlink(missing_ok=True)
            self.kept = self._learner.steps
        self._saved_at = time.monotonic()


def _commands(control: Control, n: int) -> Floats | None:
    """Speeds for `n` starts (m/s) that cover all that may be commanded; None if none is."""
    return None if control.speeds is None else np.linspace(*control.speeds, n)


def _named(init: str) -> str:
    return init if init.startswith(INITS) else "from a policy"
